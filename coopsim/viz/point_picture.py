"""Pictures of LiDAR points, seen from behind and above, as a model on a table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import STATIC_ID
from coopsim.types import Ints
from coopsim.viz import palette

_PITCH_RAD = np.radians(40.0)
_HEIGHTS_M = (0.0, 0.3, 2.0, 5.0, 10.0)
_HEIGHT_COLORS = ((52, 62, 72), (70, 84, 98), (84, 140, 150), (120, 180, 130), (205, 215, 150))
"""Colours of scenery at these heights over the ground; between them they blend."""


def draw_points(points: Floats, instance: Ints, reach_m: float, size_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw the points around an agent, ahead of it up; return the image (H, W, 3).

    Scenery is coloured by height, each actor by its id.

    Args:
        points: (N, 3) m, base frame.
        instance: (N,) id of the actor behind each point, or `STATIC_ID`.
        reach_m: half the width of what is shown.
        size_px: width and height.
    """
    width, height = size_px
    picture = np.full((height, width, 3), palette.BACKGROUND, dtype=np.uint8)
    order = np.argsort(-points[:, 0], kind="stable")  # what is nearer to the eye is painted later
    points, instance = points[order], instance[order]
    scale = width / (2 * reach_m)
    up_m = points[:, 0] * np.sin(_PITCH_RAD) + points[:, 2] * np.cos(_PITCH_RAD)
    column = np.floor(width / 2 - points[:, 1] * scale).astype(np.int64)
    row = np.floor(height / 2 - up_m * scale).astype(np.int64)
    colors = _colors(points[:, 2], instance)
    actor = instance > STATIC_ID
    inside = (column >= 0) & (column < width - 1) & (row >= 0) & (row < height - 1)
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        shown = inside & actor if right or down else inside  # points of actors are two pixels wide
        picture[row[shown] + down, column[shown] + right] = colors[shown]
    return picture


def _colors(height_m: Floats, instance: Ints) -> NDArray[np.uint8]:
    ramp = np.array(_HEIGHT_COLORS, dtype=np.float64)
    colors = np.column_stack([np.interp(height_m, _HEIGHTS_M, ramp[:, channel]) for channel in range(3)])
    for actor in np.unique(instance[instance > STATIC_ID]).tolist():
        colors[instance == actor] = palette.track_color(actor)
    return colors.astype(np.uint8)
