"""Convex outlines from a file."""

from __future__ import annotations

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

_TWICE, _OTHER = 2, 3
_ROUNDING_M = 2e-3  # that a corner may lie inwards of its neighbours: coordinates are often whole millimetres


def read_convex(entry: Entry, advice: str = "write another shape as several") -> Floats:
    """Return the corners (K, 2) m of a convex outline, counter-clockwise.

    Args:
        entry: the list of corners, either way round.
        advice: what to do with other shapes, for the error.

    Raises:
        CoopsimError: of the entry's class: there are fewer than three corners, two in one place, or they are not those
            of a convex shape.
    """
    corners = entry.points(3)
    way = _way_round(corners)
    if way == _TWICE:
        raise entry.error("outline must have every corner once; the last is joined to the first anyway")
    if way == _OTHER:
        raise entry.error(f"outline must be convex: {advice}")
    return corners if way > 0 else np.ascontiguousarray(corners[::-1])


@njit(cache=True, nogil=True)
def _way_round(corners: Floats) -> int:
    """Return the way round of a convex outline (K, 2) m: 1 counter-clockwise, -1 clockwise, else `_TWICE`, `_OTHER`."""
    count = len(corners)
    turns, inwards_m, turned_rad = np.empty(count), np.empty(count), 0.0
    for k in range(count):
        here, there, beyond = corners[k], corners[(k + 1) % count], corners[(k + 2) % count]
        ax, ay, bx, by = there[0] - here[0], there[1] - here[1], beyond[0] - there[0], beyond[1] - there[1]
        if (ax == 0 and ay == 0) or (bx == 0 and by == 0):
            return _TWICE
        turns[k] = ax * by - ay * bx
        inwards_m[k] = -turns[k] / max(exact.hypot(ax + bx, ay + by), exact.hypot(ax, ay))
        turned_rad += exact.arctan2(turns[k], ax * bx + ay * by)
    way = 1 if turns.sum() > 0 else -1
    once_round = abs(turned_rad - way * 2 * np.pi) < 1e-6
    if not once_round or (way * inwards_m).max() > _ROUNDING_M or (way * turns).max() <= 0:
        return _OTHER
    return way
