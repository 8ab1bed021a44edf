"""Combining what several agents perceive."""
