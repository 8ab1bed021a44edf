"""Uplinks: what an agent broadcasts of what it observes."""
