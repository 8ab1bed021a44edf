"""Towns that are drawn from a seed."""
