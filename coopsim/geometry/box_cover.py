"""Which boxes stand over a point on the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats


def covers(boxes: Boxes3D, point_m: Floats) -> NDArray[np.bool_]:
    """Return the mask (N,) of boxes that cover a point on the ground, one (2,) for all or one for each (N, 2)."""
    offset_m, beyond_m = boxes.center[:, :2] - point_m, boxes.size[:, 0] + boxes.size[:, 1]
    over: NDArray[np.bool_] = (np.abs(offset_m[:, 0]) < beyond_m) & (np.abs(offset_m[:, 1]) < beyond_m)
    near = np.flatnonzero(over)  # few; the others cannot
    (x, y), (length, width), yaw = offset_m[near].T, boxes.size[near, :2].T, boxes.yaw[near]
    cos, sin = np.cos(yaw), np.sin(yaw)
    over[near] = (np.abs(x * cos + y * sin) <= length / 2) & (np.abs(y * cos - x * sin) <= width / 2)
    return over
