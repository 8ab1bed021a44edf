"""Preselection of the rays from a point that may hit some boxes, so that the others need not be cast."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

_CELLS = 360
"""Cells of the full turn of azimuth, and as many from nadir to zenith."""

_SLACK_M = 0.01
"""Enlargement of the boxes: actors fill theirs to a millimetre."""


def may_hit(boxes: Boxes3D, origin_m: Floats, directions: Floats) -> Mask:
    """Return a mask (R,) of the rays that may hit a box: conservative, by each box's upright bounding cylinder.

    Args:
        boxes: N of them, upright.
        origin_m: (3,) start of all rays.
        directions: (R, 3) unit vectors.
    """
    elevation_rad = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
    around, up = _cells(np.arctan2(directions[:, 1], directions[:, 0]), elevation_rad)
    found: Mask = _covered(boxes, origin_m)[around % _CELLS, np.minimum(up, _CELLS - 1)]
    return found


def _covered(boxes: Boxes3D, origin_m: Floats) -> Mask:
    """Return which cells of azimuth and elevation (_CELLS, _CELLS) a cylinder covers."""
    away = boxes.center - origin_m
    distance_m = np.hypot(away[:, 0], away[:, 1])
    radius_m = np.hypot(boxes.size[:, 0], boxes.size[:, 1]) / 2 + _SLACK_M
    half_rad = np.where(distance_m > radius_m, np.arcsin(np.minimum(radius_m / np.maximum(distance_m, 1e-9), 1)), np.pi)
    nearest_m, farthest_m = np.maximum(distance_m - radius_m, 0.0), distance_m + radius_m
    half_m = boxes.size[:, 2] / 2 + _SLACK_M
    lowest_m, highest_m = away[:, 2] - half_m, away[:, 2] + half_m
    lowest_rad = np.arctan2(lowest_m, np.where(lowest_m < 0, nearest_m, farthest_m))
    highest_rad = np.arctan2(highest_m, np.where(highest_m > 0, nearest_m, farthest_m))
    middle_rad = np.arctan2(away[:, 1], away[:, 0])
    right, bottom = _cells(middle_rad - half_rad, lowest_rad)
    left, top = _cells(middle_rad + half_rad, highest_rad)
    # Each cylinder is a rectangle of cells, given by its four corners and filled by cumulative sums. It may reach half
    # a turn beyond either end of the turn, so there are three turns, which are folded at the end.
    cells = np.zeros((3 * _CELLS, _CELLS + 2), dtype=np.int32)
    for row, column, sign in ((right, bottom, 1), (left + 1, bottom, -1), (right, top + 1, -1), (left + 1, top + 1, 1)):
        np.add.at(cells, (row + _CELLS, column), sign)
    cells.cumsum(axis=0, out=cells)
    cells.cumsum(axis=1, out=cells)
    folded: Mask = np.any((cells[:, :_CELLS] > 0).reshape(3, _CELLS, _CELLS), axis=0)
    return folded


def _cells(azimuth_rad: Floats, elevation_rad: Floats) -> tuple[Ints, Ints]:
    """Return the cells of directions, counted from -pi and from the nadir."""
    around, up = (azimuth_rad / (2 * np.pi) + 0.5) * _CELLS, (elevation_rad / np.pi + 0.5) * _CELLS
    return np.floor(around).astype(np.int64), np.floor(up).astype(np.int64)
