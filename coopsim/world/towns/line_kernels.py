"""Distances to many lines, and lines with fewer points, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
from coopsim.types import Mask


@njit(cache=True, nogil=True)
def distances_to_lines(points: Floats, starts: Floats, ends: Floats, width_m: Floats) -> Floats:
    """Return the distances (N,) of points (N, 2) m from the nearest of straight lines (M, 2), less its width (M,)."""
    found = np.full(len(points), np.inf)
    for n in range(len(points)):
        x, y = points[n]
        for m in range(len(starts)):
            from_x, from_y = x - starts[m, 0], y - starts[m, 1]
            # Most lines are far: their distance is at least that of their start, less their length (chords are short).
            along_x, along_y = ends[m, 0] - starts[m, 0], ends[m, 1] - starts[m, 1]
            length2 = along_x * along_x + along_y * along_y
            share = (from_x * along_x + from_y * along_y) / max(length2, 1e-12)
            share = min(max(share, 0.0), 1.0)
            off_x, off_y = from_x - share * along_x, from_y - share * along_y
            reach = found[n] + width_m[m]
            squared = off_x * off_x + off_y * off_y
            if reach == np.inf or (reach > 0 and squared < reach * reach):
                found[n] = np.sqrt(squared) - width_m[m]
    return found


@njit(cache=True, nogil=True)
def keep_corners(points: Floats, most_m: float) -> Mask:
    """Return the mask (N,) of points (N, D) that a line through fewer points needs to stay within `most_m` of all.

    The first and last are kept. The method is Ramer's (1972) and Douglas and Peucker's (1973).
    """
    kept = np.zeros(len(points), np.bool_)
    kept[0] = kept[-1] = True
    stack = [(0, len(points) - 1)]
    while len(stack) > 0:
        first, last = stack.pop()
        if last - first < 2:
            continue
        along = points[last] - points[first]
        length2 = max((along * along).sum(), 1e-12)
        worst, where = most_m * most_m, -1
        for k in range(first + 1, last):
            offset = points[k] - points[first]
            share = min(max((offset * along).sum() / length2, 0.0), 1.0)
            apart = offset - share * along
            squared = (apart * apart).sum()
            if squared > worst:
                worst, where = squared, k
        if where >= 0:
            kept[where] = True
            stack.append((first, where))
            stack.append((where, last))
    return kept
