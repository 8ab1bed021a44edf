"""Ground that convex outlines and lines take up, by separating axes, compiled."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit

_MOST_CORNERS = 16


class TakenGround:
    """Convex outlines and lines, each with a distance that others keep from it."""

    def __init__(self) -> None:
        self._corners = np.zeros((256, _MOST_CORNERS, 2))
        self._count = np.zeros(256, np.int64)
        self._keep_m = np.zeros(256)
        self._bounds = np.zeros((256, 4))
        self._size = 0

    def take(self, outline: Floats, keep_m: float = 0.0) -> None:
        """Take a convex outline (K, 2) m, or a straight line between two points, and `keep_m` around it."""
        if self._size == len(self._count):
            self._grow()
        row, count = self._size, len(outline)
        self._corners[row, :count], self._count[row], self._keep_m[row] = outline, count, keep_m
        self._bounds[row, :2], self._bounds[row, 2:] = outline.min(axis=0) - keep_m, outline.max(axis=0) + keep_m
        self._size += 1

    def take_lines(self, starts: Floats, ends: Floats, keep_m: Floats) -> None:
        """Take straight lines from `starts` to `ends` (N, 2) m, and `keep_m` (N,) around each."""
        while self._size + len(starts) > len(self._count):
            self._grow()
        rows = slice(self._size, self._size + len(starts))
        self._corners[rows, 0], self._corners[rows, 1] = starts, ends
        self._count[rows], self._keep_m[rows] = 2, keep_m
        self._bounds[rows, :2] = np.minimum(starts, ends) - keep_m[:, None]
        self._bounds[rows, 2:] = np.maximum(starts, ends) + keep_m[:, None]
        self._size += len(starts)

    def is_free(self, outline: Floats, gap_m: float = 0.0) -> bool:
        """Return whether a convex outline (K, 2) m, or a line, lies apart from all that is taken, by `gap_m` more."""
        taken = (self._corners, self._count, self._keep_m, self._bounds)
        return bool(is_apart(np.ascontiguousarray(outline), gap_m, *taken, self._size))

    def try_take(self, outlines: list[Floats], gap_m: float = 0.0) -> bool:
        """Take all convex outlines if all of them are free; return whether they are."""
        free = all(self.is_free(outline, gap_m) for outline in outlines)
        for outline in outlines if free else ():
            self.take(outline)
        return free

    def _grow(self) -> None:
        for name in ("_corners", "_count", "_keep_m", "_bounds"):
            rows = getattr(self, name)
            setattr(self, name, np.concatenate([rows, np.zeros_like(rows)]))


@njit(cache=True, nogil=True)
def is_apart(
    outline: Floats, gap_m: float, corners: Floats, count: Ints, keep_m: Floats, bounds: Floats, size: int
) -> bool:
    """Return whether a convex outline or line (K, 2) m is apart from the first `size` of N others, by separating axes.

    Args:
        outline: (K, 2) m.
        gap_m: distance needed from all.
        corners: (N, M, 2) m, of which `count` (N,) are used.
        count: (N,) numbers of corners.
        keep_m: (N,) distance needed from each, besides `gap_m`.
        bounds: (N, 4) m, least and greatest x and y of each, with its `keep_m`.
        size: number of rows in use.
    """
    low_x, low_y = outline[:, 0].min() - gap_m, outline[:, 1].min() - gap_m
    high_x, high_y = outline[:, 0].max() + gap_m, outline[:, 1].max() + gap_m
    for n in range(size):
        if bounds[n, 0] >= high_x or bounds[n, 2] <= low_x or bounds[n, 1] >= high_y or bounds[n, 3] <= low_y:
            continue
        other, need_m = corners[n, : count[n]], gap_m + keep_m[n]
        if _widest_gap(outline, other, need_m) < need_m and _widest_gap(other, outline, need_m) < need_m:
            return False
    return True


@njit(cache=True, nogil=True)
def _widest_gap(outline: Floats, other: Floats, enough_m: float) -> float:
    """Return the widest gap between two convex outlines on the axes across one's edges (and along a line's), m.

    It is at most their distance, and less where two corners face each other; the search ends at `enough_m`.
    """
    widest, count = -np.inf, len(outline)
    for k in range(count):
        there = (k + 1) % count
        along_x, along_y = outline[there, 0] - outline[k, 0], outline[there, 1] - outline[k, 1]
        length = np.sqrt(along_x * along_x + along_y * along_y)
        if length < 1e-9:
            continue
        for axis in range(2 if count == 2 else 1):
            x, y = (along_y / length, -along_x / length) if axis == 0 else (along_x / length, along_y / length)
            low, high = np.inf, -np.inf
            for n in range(count):
                place = outline[n, 0] * x + outline[n, 1] * y
                low, high = min(low, place), max(high, place)
            other_low, other_high = np.inf, -np.inf
            for n in range(len(other)):
                place = other[n, 0] * x + other[n, 1] * y
                other_low, other_high = min(other_low, place), max(other_high, place)
            widest = max(widest, other_low - high, low - other_high)
            if widest >= enough_m:
                return widest
    return widest
