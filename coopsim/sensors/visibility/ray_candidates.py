"""Preselection of the rays from a point that may hit some boxes, and how far: no others need to be cast."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

_CELLS = 360
"""Cells of the full turn of azimuth, and as many from nadir to zenith."""

_SLACK_M = 0.01
"""Enlargement of the boxes: actors fill theirs to a millimetre."""


def angles_of(directions: Floats) -> tuple[Floats, Floats]:
    """Return the azimuths (R,) and elevations (R,), rad, of unit vectors (R, 3)."""
    azimuth_rad: Floats = np.arctan2(directions[:, 1], directions[:, 0])
    elevation_rad: Floats = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
    return azimuth_rad, elevation_rad


def reaches(boxes: Boxes3D, origin_m: Floats, azimuth_rad: Floats, elevation_rad: Floats) -> Floats:
    """Return the distances (R,) m within which rays meet all the boxes that they meet; 0 for rays that meet none.

    Conservative, by each box's upright bounding cylinder.

    Args:
        boxes: N of them, upright.
        origin_m: (3,) start of all rays.
        azimuth_rad: (R,) of the rays; any number of turns.
        elevation_rad: (R,) of the rays.
    """
    around, up = _cells(azimuth_rad, elevation_rad)
    found: Floats = _reaches_by_cell(boxes, origin_m)[around % _CELLS, np.minimum(up, _CELLS - 1)]
    return found


def _reaches_by_cell(boxes: Boxes3D, origin_m: Floats) -> Floats:
    """Return the distances (_CELLS, _CELLS) by azimuth and elevation, m, to the far sides of cylinders; 0: none."""
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
    first = _cells(middle_rad - half_rad, lowest_rad)
    last = _cells(middle_rad + half_rad, highest_rad)
    reach_m = np.hypot(farthest_m, np.maximum(np.abs(lowest_m), np.abs(highest_m)))
    return _paint(*first, *last, reach_m)


@njit(cache=True, nogil=True)
def _paint(right: Ints, bottom: Ints, left: Ints, top: Ints, reach_m: Floats) -> Floats:
    """Return the largest number of the rectangles (N,) on each cell (_CELLS, _CELLS); the first axis is a circle."""
    cells = np.zeros((_CELLS, _CELLS))
    for n in range(len(reach_m)):
        for turn in range(right[n], min(left[n], right[n] + _CELLS - 1) + 1):
            for up in range(bottom[n], min(top[n], _CELLS - 1) + 1):
                cells[turn % _CELLS, up] = max(cells[turn % _CELLS, up], reach_m[n])
    return cells


def _cells(azimuth_rad: Floats, elevation_rad: Floats) -> tuple[Ints, Ints]:
    """Return the cells of directions, counted from -pi and from the nadir."""
    around, up = (azimuth_rad / (2 * np.pi) + 0.5) * _CELLS, (elevation_rad / np.pi + 0.5) * _CELLS
    return np.floor(around).astype(np.int64), np.floor(up).astype(np.int64)
