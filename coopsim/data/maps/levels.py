"""Ways and lanes of a map that cross in height, as on bridges: traffic is planar, so a cut has to avoid them."""

from __future__ import annotations

import numpy as np

from coopsim.data.maps.street_map import DRIVEN, StreetMap
from coopsim.geometry.outlines import crossing_of
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

LEVEL_M = 3.0
"""Least height between two levels."""


def crossings_in_height(street_map: StreetMap) -> list[tuple[str, str, tuple[float, float]]]:
    """Return the driven lanes and ways whose middles cross more than 3 m apart in height.

    Each is the ids of two of them, in the map's order, and where the first such crossing is (x, y), m.
    """
    lines = {lane.id: lane.line for lane in street_map.lanes.values() if lane.kind in DRIVEN}
    lines |= {way.id: way.line for way in street_map.ways.values()}
    names = list(lines)
    if not names:
        return []
    first = np.cumsum([0, *(len(line) for line in lines.values())])
    found = np.empty((64, 4))
    points = np.concatenate(list(lines.values()))
    while (count := _crossings(points, first, found)) > len(found):
        found = np.empty((count, 4))
    return [(names[int(a)], names[int(b)], (x, y)) for a, b, x, y in found[:count].tolist()]


@njit(cache=True, nogil=True)
def _crossings(points: Floats, first: Ints, found: Floats) -> int:
    """Fill `found` (N, 4) with two lines' numbers and the place of their crossing in height; return how many there are.

    `points` (P, 3) m are those of all lines, `first` (K + 1,) the first one of each line, and P.
    """
    count, lines = 0, len(first) - 1
    box = np.empty((lines, 6))
    for k in range(lines):
        for axis in range(3):
            own = points[first[k] : first[k + 1], axis]
            box[k, axis], box[k, axis + 3] = own.min(), own.max()
    for a in range(lines):
        for b in range(a + 1, lines):
            if box[a, 0] > box[b, 3] or box[b, 0] > box[a, 3] or box[a, 1] > box[b, 4] or box[b, 1] > box[a, 4]:
                continue
            if box[a, 5] - box[b, 2] <= LEVEL_M and box[b, 5] - box[a, 2] <= LEVEL_M:
                continue
            x, y = _first_crossing(points[first[a] : first[a + 1]], points[first[b] : first[b + 1]])
            if not np.isnan(x):
                if count < len(found):
                    found[count] = float(a), float(b), x, y
                count += 1
    return count


@njit(cache=True, nogil=True)
def _first_crossing(a: Floats, b: Floats) -> tuple[float, float]:
    """Return where line a (N, 3) first crosses line b (M, 3) far above or below it; NaN if nowhere."""
    for i in range(len(a) - 1):
        for k in range(len(b) - 1):
            along_a, along_b = crossing_of(a, i, b, k)
            height_m = a[i, 2] + along_a * (a[i + 1, 2] - a[i, 2])
            if abs(height_m - b[k, 2] - along_b * (b[k + 1, 2] - b[k, 2])) > LEVEL_M:  # never where they do not meet
                return a[i, 0] + along_a * (a[i + 1, 0] - a[i, 0]), a[i, 1] + along_a * (a[i + 1, 1] - a[i, 1])
    return np.nan, np.nan
