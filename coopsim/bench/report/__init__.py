"""A benchmark's results as pages, tables and pictures."""
