"""A benchmark's grid: policies, conditions, seeds."""
