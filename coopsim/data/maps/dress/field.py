"""Distances from the roads of a map on a grid, and lines along the roads at a distance from these.

Kerbs, people's ways and the borders of private ground are lines of equal distance. They go around every block, whatever
the lanes are like, and never lie on a road.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

_STEP_M, _MOST_CELLS = 1.0, 4_000_000
_REACH_M = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """Distances on a grid.

    Attributes:
        low: (2,) m, the first corner.
        step_m: between corners.
        distance_m: (X, Y) from the nearest edge, less than zero on the surface, at most 12 m.
        owner: (X, Y) number of the nearest piece, -1: none is near.
    """

    low: Floats
    step_m: float
    distance_m: Floats
    owner: Ints

    def at(self, points: Floats) -> Floats:
        """Return the distances (N,) m at points (N, 2) m."""
        return _sample(self.distance_m, self._cells(points))

    def owner_at(self, points: Floats) -> Ints:
        """Return the numbers (N,) of the pieces nearest to points (N, 2) m."""
        x, y = np.clip(np.rint(self._cells(points)), 0, np.array(self.owner.shape) - 1).astype(np.int64).T
        found: Ints = self.owner[x, y]
        return found

    def away(self, points: Floats) -> Floats:
        """Return unit vectors (N, 2) straight away from the surface at points (N, 2) m."""
        half_m = self.step_m / 2
        steps = [np.array([half_m, 0.0]), np.array([0.0, half_m])]
        rise = np.stack([self.at(points + step) - self.at(points - step) for step in steps], axis=1)
        unit: Floats = rise / np.maximum(exact.norm(rise, axis=1), 1e-9)[:, None]
        return unit

    def _cells(self, points: Floats) -> Floats:
        return np.ascontiguousarray((points - self.low) / self.step_m)

    def with_pieces(self, pieces: Floats) -> Field:
        """Return the distances from further straight pieces (S, 6), too: two ends and half the width at each, m."""
        distance_m, owner = self.distance_m.copy(), self.owner.copy()
        scaled = np.ascontiguousarray((pieces - [*self.low, *self.low, 0.0, 0.0]) / self.step_m)
        _stamp(distance_m, owner, scaled, self.step_m)
        return replace(self, distance_m=distance_m, owner=owner)

    def of(self, pieces: Floats) -> Field:
        """Return the distances from other pieces (S, 6) on the same grid."""
        bare = np.full_like(self.distance_m, _REACH_M), np.full_like(self.owner, -1)
        return Field(self.low, self.step_m, *bare).with_pieces(pieces)

    def lines(self, level_m: float) -> list[Floats]:
        """Return all lines (N, 2) m at a distance from the surface, closed, which is on their left."""
        values = np.full(self.distance_m.shape, _REACH_M)  # at the grid's edge, too: lines end nowhere
        values[1:-1, 1:-1] = self.distance_m[1:-1, 1:-1] - level_m
        points, ends = _contours(values)
        return np.split(self.low + self.step_m * points, ends[:-1]) if len(ends) else []


def field_of(pieces: Floats) -> Field:
    """Return the distances from straight pieces (S, 6): two ends and half the width at each, m."""
    ends = pieces[:, :4].reshape(-1, 2)
    margin = _REACH_M + float(pieces[:, 4:].max()) + 2.0
    low, high = ends.min(axis=0) - margin, ends.max(axis=0) + margin
    step_m = max(_STEP_M, float(np.sqrt((high - low).prod() / _MOST_CELLS)))
    wide, tall = (np.ceil((high - low) / step_m).astype(np.int64) + 1).tolist()
    return Field(low, step_m, np.zeros((wide, tall)), np.zeros((wide, tall), np.int64)).of(pieces)


@njit(cache=True, nogil=True)
def _stamp(distance_m: Floats, owner: Ints, pieces: Floats, step_m: float) -> None:
    """Lower distances (X, Y) where pieces (S, 6), in steps of the grid, are nearer."""
    for s in range(len(pieces)):
        ax, ay, bx, by, half_a, half_b = pieces[s]
        along_x, along_y = bx - ax, by - ay
        length2 = max(along_x * along_x + along_y * along_y, 1e-12)
        reach = max(half_a, half_b) + _REACH_M / step_m
        first_x, first_y = max(int(min(ax, bx) - reach), 0), max(int(min(ay, by) - reach), 0)
        for x in range(first_x, min(int(max(ax, bx) + reach) + 2, distance_m.shape[0])):
            for y in range(first_y, min(int(max(ay, by) + reach) + 2, distance_m.shape[1])):
                share = min(max(((x - ax) * along_x + (y - ay) * along_y) / length2, 0.0), 1.0)
                off_x, off_y = x - ax - share * along_x, y - ay - share * along_y
                away = np.sqrt(off_x * off_x + off_y * off_y) - half_a - share * (half_b - half_a)
                if away * step_m < distance_m[x, y]:
                    distance_m[x, y], owner[x, y] = away * step_m, s


@njit(cache=True, nogil=True)
def _sample(values: Floats, cells: Floats) -> Floats:
    found = np.empty(len(cells))
    for n in range(len(cells)):
        found[n] = value_at(values, cells[n, 0], cells[n, 1])
    return found


@njit(cache=True, nogil=True)
def value_at(values: Floats, x: float, y: float) -> float:
    """Return the value between those of a grid (X, Y) at a place in its steps; beyond its edge that of the edge."""
    x, y = min(max(x, 0.0), values.shape[0] - 1.001), min(max(y, 0.0), values.shape[1] - 1.001)
    i, j = int(x), int(y)
    low = values[i, j] + (x - i) * (values[i + 1, j] - values[i, j])
    high = values[i, j + 1] + (x - i) * (values[i + 1, j + 1] - values[i, j + 1])
    return float(low + (y - j) * (high - low))


@njit(cache=True, nogil=True)
def _contours(values: Floats) -> tuple[Floats, Ints]:
    """Return the lines where a grid (X, Y) is 0, as points (N, 2) in its steps, and the end (L,) of each line.

    Values below are on the left ("marching squares", Lorensen and Cline 1987). Those at the grid's edge must be above.
    """
    wide, high = values.shape
    after = np.full(2 * wide * high, -1, np.int64)  # from an edge between two corners, along x or along y, to the next
    inside, edges = np.empty(4, np.bool_), np.empty(4, np.int64)
    for x in range(wide - 1):
        for y in range(high - 1):
            inside[0], inside[1] = values[x, y] < 0, values[x + 1, y] < 0
            inside[2], inside[3] = values[x + 1, y + 1] < 0, values[x, y + 1] < 0
            count = int(inside[0]) + int(inside[1]) + int(inside[2]) + int(inside[3])
            if count in (0, 4):
                continue
            cell = 2 * (x * high + y)
            edges[0], edges[1], edges[2], edges[3] = cell, cell + 2 * high + 1, cell + 2, cell + 1
            middle = values[x, y] + values[x + 1, y] + values[x + 1, y + 1] + values[x, y + 1]
            step = -1 if count == 2 and inside[0] == inside[2] and middle >= 0 else 1
            for k in range(4):
                if inside[k] and not inside[(k + 1) % 4]:
                    other = (k + step) % 4
                    while inside[other] or not inside[(other + 1) % 4]:
                        other = (other + step) % 4
                    after[edges[k]] = edges[other]
    total = int((after >= 0).sum())
    points, ends, size, lines = np.empty((total, 2)), np.empty(total, np.int64), 0, 0
    for first in range(len(after)):
        here = first
        while after[here] >= 0:
            x, y = here // 2 // high, here // 2 % high
            over_x, over_y = (x, y + 1) if here % 2 else (x + 1, y)
            share = values[x, y] / (values[x, y] - values[over_x, over_y])
            points[size, 0], points[size, 1] = x + share * (over_x - x), y + share * (over_y - y)
            size += 1
            there = after[here]
            after[here] = -1
            here = there
        if size and (lines == 0 or ends[lines - 1] < size):
            ends[lines] = size
            lines += 1
    return points, ends[:lines]
