"""What sensors may measure at most: beyond, a number is a slip of units, and would be sensed as nothing at all."""

from __future__ import annotations

FARTHEST_MOUNT_M = 100.0
"""From an agent to a sensor that it carries, along each axis."""

FARTHEST_M = 10_000.0
"""From a sensor to what it sees."""

NEAREST_M = 0.001
"""The same at least, for cameras: OpenGL's buffer of depths becomes too coarse for what is nearer."""

FOCAL_PX = (0.001, 1e6)
"""Shortest and longest focal length: one sees all before it in a pixel, the other a millimetre in a kilometre."""

FARTHEST_AXIS_PX = 1e6
"""From a picture's first pixel to the optical axis."""

MOST_RAYS = 2**23
"""Of a sweep: more would fill the memory. 128 beams in 16384 columns are a quarter of that."""
