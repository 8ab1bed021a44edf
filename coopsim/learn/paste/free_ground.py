"""Ground of a sweep: its height, and where nothing stands on it."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, generic_filter, map_coordinates

from coopsim.geometry.se3 import Floats
from coopsim.types import Mask

REACH_M = 64.0
"""Half the edge of the square in which the ground is known."""

_COARSE_M, _FINE_M = 2.0, 0.4
_LOW_PERCENT, _LEAST_POINTS = 10, 3
_ON_GROUND_M, _STANDS_M, _TALLEST_M = 0.25, 0.3, 4.5
_MOST_OFF_M = 3.0  # of the ground from the plane under the car
_STEEPEST = 0.12
_KEPT_OFF_M = 0.4
_SWEPT_M, _SAMPLES = 0.5, 12  # height under which a ray that reaches the ground shows that nothing is there


class FreeGround:
    """Height of the ground under a sweep, and where an object can stand.

    Ground is the tenth percentile of the heights in cells of 2 m, smoothed by the median of the cells around. A place
    is free if a ray that reached the ground passed it less than 0.5 m over the ground, as nothing taller can be there,
    and nothing stands within 0.4 m.

    Args:
        points: (N, 3) of a sweep in a base frame, with its ground near z = 0.
        origin_m: (3,) place of the sensor.
    """

    def __init__(self, points: Floats, origin_m: Floats) -> None:
        inside = (np.abs(points[:, :2]) < REACH_M).all(axis=1) & (np.abs(points[:, 2]) < _TALLEST_M + _MOST_OFF_M)
        points = points[inside]
        self._low = _lowest(points)
        above_m = points[:, 2] - self.heights(points[:, :2])
        size = round(2 * REACH_M / _FINE_M)
        cell = np.floor((points[:, :2] + REACH_M) / _FINE_M).astype(np.int64).clip(0, size - 1)
        seen, taken = np.zeros((size, size), np.bool_), np.zeros((size, size), np.bool_)
        swept = _swept(points[np.abs(above_m) < _ON_GROUND_M, :2], origin_m)
        seen[tuple(np.floor((swept + REACH_M) / _FINE_M).astype(np.int64).clip(0, size - 1).T)] = True
        taken[tuple(cell[(above_m > _STANDS_M) & (above_m < _TALLEST_M)].T)] = True
        near, clear = (distance_transform_edt(~cells) * _FINE_M for cells in (seen, taken))
        self._free = (near <= _KEPT_OFF_M) & (clear > _KEPT_OFF_M)

    def heights(self, xy_m: Floats) -> Floats:
        """Return the height (N,) m of the ground at places (N, 2)."""
        at = (xy_m + REACH_M) / _COARSE_M - 0.5
        heights: Floats = map_coordinates(self._low, at.T, order=1, mode="nearest")
        return heights

    def copy(self) -> FreeGround:
        """Return ground that can be taken by itself."""
        copied = copy(self)
        copied._free = self._free.copy()
        return copied

    def take(self, box: Floats) -> None:
        """Mark the footprint of a box (7,) as taken."""
        cells = _cells(box, _KEPT_OFF_M)
        self._free[tuple(cells[(cells >= 0).all(axis=1) & (cells < len(self._free)).all(axis=1)].T)] = False

    def fits(self, box: Floats) -> bool:
        """Return whether a box (7,) can stand here: all of its footprint is free, and nowhere steep."""
        cells = _cells(box, 0.0)
        if (cells < 0).any() or (cells >= len(self._free)).any() or not self._free[tuple(cells.T)].all():
            return False
        spots: Floats = (cells.astype(np.float64) + 0.5) * _FINE_M - REACH_M
        rise = float(np.ptp(self.heights(spots)))
        return rise < 0.1 + _STEEPEST * float(np.hypot(box[3], box[4]))


def _swept(ground: Floats, origin_m: Floats) -> Floats:
    """Return places (N, 2) that rays to points (G, 2) of the ground pass closely over."""
    share = np.linspace(max(0.0, 1.0 - _SWEPT_M / max(float(origin_m[2]), _SWEPT_M)), 1.0, _SAMPLES)
    places: Floats = (origin_m[:2] + share[:, None, None] * (ground - origin_m[:2])).reshape(-1, 2)
    return places


def _cells(box: Floats, margin_m: float) -> NDArray[np.int64]:
    """Return the fine cells (C, 2) of the footprint of a box (7,) that is larger by a margin on all sides."""
    half = box[3:5] / 2 + margin_m
    x, y = (np.linspace(-each, each, int(2 * each / (_FINE_M / 2)) + 2) for each in half)
    local = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    cos, sin = np.cos(box[6]), np.sin(box[6])
    spots = local @ np.array([[cos, sin], [-sin, cos]]) + box[:2]
    return np.unique(np.floor((spots + REACH_M) / _FINE_M).astype(np.int64), axis=0)


def _lowest(points: Floats) -> Floats:
    """Return the height of the ground in coarse cells (C, C): where none is known, that of the nearest."""
    size = round(2 * REACH_M / _COARSE_M)
    cell = np.floor((points[:, :2] + REACH_M) / _COARSE_M).astype(np.int64).clip(0, size - 1)
    number = cell[:, 0] * size + cell[:, 1]
    order = np.lexsort((points[:, 2], number))
    number, height = number[order], points[order, 2]
    cells, first, count = np.unique(number, return_index=True, return_counts=True)
    low = np.full(size * size, np.nan)
    low[cells] = height[first + count * _LOW_PERCENT // 100]
    low[cells[count < _LEAST_POINTS]] = np.nan
    low[np.abs(low) > _MOST_OFF_M] = np.nan
    smooth = generic_filter(low.reshape(size, size), _median, size=3, mode="constant", cval=np.nan)
    known = np.isfinite(smooth)
    if not known.any():
        return np.zeros((size, size))
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: Floats = smooth[tuple(nearest)]
    return filled


def _median(values: Floats) -> float:
    known: Mask = np.isfinite(values)
    return float(np.median(values[known])) if known.sum() >= 2 else float("nan")
