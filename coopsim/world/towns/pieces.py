"""Surfaces cut into convex pieces, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
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
            if np.abs(surfaces[n, k] - before).max() > _LEAST_M:
                corners[kept] = surfaces[n, k]
                kept += 1
        if kept < 3:
            continue
        turns = np.array(
            [_turn(corners[k - 1 if k else kept - 1], corners[k], corners[(k + 1) % kept]) for k in range(kept)]
        )
        if (turns > _LEAST_M2).all() or (turns < -_LEAST_M2).all():
            pieces[size, :kept], count[size] = corners[:kept], kept
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
    along, on = corner - before, after - corner
    return float(along[0] * on[1] - along[1] * on[0])
