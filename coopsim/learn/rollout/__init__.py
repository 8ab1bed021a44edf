"""Clips from the simulator: worlds drawn from a recipe, and what their agents sense."""
