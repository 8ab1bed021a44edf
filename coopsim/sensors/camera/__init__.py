"""Cameras: rigs, lenses, light, pictures."""
