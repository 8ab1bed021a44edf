"""Distances, simplified lines and convex pieces, compiled."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, Mask
from coopsim.support.kernels import njit

_SAME_M2 = 1e-9
"""Points are equally far from a line if squares of their distances differ by less, m^2: processors round differently,
and no two of them may choose different points."""


def along_of(line: Floats) -> Floats:
    """Return the distance (K,) of each corner from the start of a line (K, 2 or more) in the plane, m."""
    return np.concatenate([[0.0], np.cumsum(exact.norm(np.diff(line[:, :2], axis=0)))])


@njit(cache=True, nogil=True)
def crossing_of(a: Floats, i: int, b: Floats, k: int) -> tuple[float, float]:
    """Return where piece `i` of a line (N, 2 or more) and piece `k` of another meet in the plane, as shares of each.

    NaN if they do not. Parallel pieces never do.
    """
    rx, ry = a[i + 1, 0] - a[i, 0], a[i + 1, 1] - a[i, 1]
    sx, sy = b[k + 1, 0] - b[k, 0], b[k + 1, 1] - b[k, 1]
    area = rx * sy - ry * sx
    if area == 0.0:
        return np.nan, np.nan
    dx, dy = b[k, 0] - a[i, 0], b[k, 1] - a[i, 1]
    along_a, along_b = (dx * sy - dy * sx) / area, (dx * ry - dy * rx) / area
    if 0 <= along_a <= 1 and 0 <= along_b <= 1:
        return along_a, along_b
    return np.nan, np.nan


@njit(cache=True, nogil=True)
def lines_cross(a: Floats, b: Floats) -> bool:
    """Return whether two polylines (N, 2) and (M, 2) meet; parallel pieces do not cross."""
    for i in range(len(a) - 1):
        for k in range(len(b) - 1):
            if not np.isnan(crossing_of(a, i, b, k)[0]):
                return True
    return False


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
    stack, waiting = np.empty((len(points), 2), np.int64), 1
    stack[0, 0], stack[0, 1] = 0, len(points) - 1
    while waiting > 0:
        waiting -= 1
        first, last = stack[waiting, 0], stack[waiting, 1]
        where = _farthest(points, first, last, most_m)
        if where >= 0:
            kept[where] = True
            stack[waiting, 0], stack[waiting, 1] = first, where
            stack[waiting + 1, 0], stack[waiting + 1, 1] = where, last
            waiting += 2
    return kept


@njit(cache=True, nogil=True)
def _farthest(points: Floats, first: int, last: int, most_m: float) -> int:
    """Return the point between two that is farthest from the line between them; -1: none is farther than `most_m`."""
    length2, worst, where = 0.0, most_m * most_m, -1
    for axis in range(points.shape[1]):
        length2 += np.square(points[last, axis] - points[first, axis])
    length2 = max(length2, 1e-12)
    for k in range(first + 1, last):
        share, squared = 0.0, 0.0
        for axis in range(points.shape[1]):
            share += (points[k, axis] - points[first, axis]) * (points[last, axis] - points[first, axis])
        share = min(max(share / length2, 0.0), 1.0)
        for axis in range(points.shape[1]):
            along = points[last, axis] - points[first, axis]
            squared += np.square(points[k, axis] - points[first, axis] - share * along)
        if squared > worst + _SAME_M2:
            worst, where = squared, k
    return where


_LEAST_M, _LEAST_M2 = 0.03, 0.01  # of an edge, and twice that of a triangle of three corners in a row


@njit(cache=True, nogil=True)
def convex_pieces(surfaces: Floats) -> tuple[Floats, Ints]:
    """Return surfaces without double corners: whole if they are convex, else their triangles; none that are slits.

    Args:
        surfaces: (N, K, 2) m, with K = 3 or 4 corners each.

    Returns:
        Corners (M, K, 2) m, and the number (M,) of them that are used.
    """
    most = surfaces.shape[1]
    pieces, count, size = np.zeros((2 * len(surfaces), most, 2)), np.zeros(2 * len(surfaces), np.int64), 0
    corners = np.empty((most, 2))
    for n in range(len(surfaces)):
        kept = 0
        for k in range(most):
            before = surfaces[n, k - 1 if k else most - 1]
            here = surfaces[n, k]
            if max(abs(here[0] - before[0]), abs(here[1] - before[1])) > _LEAST_M:
                corners[kept] = here
                kept += 1
        if kept < 3:
            continue
        left, right = 0, 0
        for k in range(kept):
            turn = _turn(corners[k - 1 if k else kept - 1], corners[k], corners[(k + 1) % kept])
            left, right = left + (turn > _LEAST_M2), right + (turn < -_LEAST_M2)
        if kept in (left, right):
            for k in range(kept):
                pieces[size, k] = corners[k]
            count[size] = kept
            size += 1
        elif kept == 4:
            for second in (1, 2):
                if abs(_turn(corners[0], corners[second], corners[second + 1])) > _LEAST_M2:
                    pieces[size, 0], pieces[size, 1], pieces[size, 2] = corners[0], corners[second], corners[second + 1]
                    count[size] = 3
                    size += 1
    return pieces[:size], count[:size]


@njit(cache=True, nogil=True)
def _turn(before: Floats, corner: Floats, after: Floats) -> float:
    """Return twice the area of the triangle of three corners (2,), m2; positive if they turn to the left."""
    along_x, along_y = corner[0] - before[0], corner[1] - before[1]
    return float(along_x * (after[1] - corner[1]) - along_y * (after[0] - corner[0]))
