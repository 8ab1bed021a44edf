"""Surfaces cut into convex pieces, compiled."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

_LEAST_M, _LEAST_M2 = 0.03, 0.01  # of an edge, and twice that of a triangle of three corners in a row


@njit(cache=True, nogil=True)
def convex_pieces(surfaces: Floats) -> tuple[Floats, Ints]:
    """Return surfaces without double corners: whole if they are convex, else their triangles; none that are slits.

    Args:
        surfaces: (N, K, 2) m of K = 3 or 4 corners each.

    Returns:
        Corners (M, K, 2) m, and how many (M,) of each are used.
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
    along_x, along_y, on_x, on_y = (
        corner[0] - before[0],
        corner[1] - before[1],
        after[0] - corner[0],
        after[1] - corner[1],
    )
    return float(along_x * on_y - along_y * on_x)
