"""Cameras: lenses, rigs, light, pictures, renderers."""
