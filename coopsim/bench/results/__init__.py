"""A benchmark's results as arrays and statistics."""
