"""Observations and actions as spaces and dicts of arrays."""
