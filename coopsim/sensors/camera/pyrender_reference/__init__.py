"""Cameras drawn by pyrender (`renderer="pyrender"`), the reference of the other renderers."""
