"""Ground that outlines cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, Mask
from coopsim.support.kernels import njit


class Surface:
    """The union of outlines (K, 2) m of any shape."""

    def __init__(self, outlines: Sequence[Floats]) -> None:
        self._corners = np.concatenate([np.zeros((0, 2)), *outlines])
        self._ends = np.cumsum([len(outline) for outline in outlines], dtype=np.int64)
        bounds = [[*outline.min(axis=0), *outline.max(axis=0)] for outline in outlines]
        self._bounds = np.array(bounds, dtype=np.float64).reshape(-1, 4)

    def covers(self, points: Floats) -> Mask:
        """Return the mask (N,) of points (N, 2) m that lie in one of the outlines."""
        mask: Mask = _covers(np.ascontiguousarray(points), self._corners, self._ends, self._bounds)
        return mask


@njit(cache=True, nogil=True)
def _covers(points: Floats, corners: Floats, ends: Ints, bounds: Floats) -> Mask:
    covered = np.zeros(len(points), np.bool_)
    for n in range(len(points)):
        x, y = points[n]
        for k in range(len(ends)):
            if x < bounds[k, 0] or y < bounds[k, 1] or x > bounds[k, 2] or y > bounds[k, 3]:
                continue
            inside, before = False, ends[k] - 1
            for at in range(ends[k - 1] if k else 0, ends[k]):
                (ax, ay), (bx, by) = corners[before], corners[at]
                if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
                    inside = not inside
                before = at
            if inside:
                covered[n] = True
                break
    return covered
