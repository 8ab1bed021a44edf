"""Cameras: lenses, rigs, daylight, renderers, and the images of all agents' cameras.

Input is a frame's triangles and the agents' poses; output is `CameraImage`s. Start with `picture.py`.
"""
