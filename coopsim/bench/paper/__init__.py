"""A benchmark's results as a paper has them: tables, a figure, and what others need to get the same numbers."""
