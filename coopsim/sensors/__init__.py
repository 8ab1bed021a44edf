"""Sensors: LiDAR sweeps, camera images and visibility, made from the triangles of the world.

Input is a frame's triangles (`SceneGeometry`) and the agents' poses; output is a `Sweep` for each LiDAR and a
`CameraImage` for each camera. Start with `lidar/lidar.py` and `camera/picture.py`. The constants below are limits of
settings: a number beyond them is a slip of units.
"""

FARTHEST_MOUNT_M = 100.0
"""Distance from an agent to a sensor that it carries, along each axis."""

FARTHEST_M = 10_000.0
"""Range of a sensor."""

NEAREST_M = 0.001
"""Near plane of a camera: with a nearer one, OpenGL's depth buffer would be too coarse."""

FOCAL_PX = (0.001, 1e6)
"""Shortest and longest focal length: the view ahead in one pixel, and a millimetre at a kilometre."""

FARTHEST_AXIS_PX = 1e6
"""Distance from an image's first pixel to the optical axis."""

MOST_RAYS = 2**23
"""Rays of a sweep; more would fill the memory. 128 beams in 16384 columns are a quarter of this."""
