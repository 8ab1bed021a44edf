"""A benchmark's engine: cells as jobs, by processes or Ray."""
