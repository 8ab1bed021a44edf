"""Ground that rises and falls: one smooth surface through given heights."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.places.relief import Relief, drape
from coopsim.world.snapshot import StaticPart

CELL_M = 10.0
"""Of the surface's grid: a road on a vertical curve of 500 m differs by 2.5 cm from it."""

STEEPEST = 0.12
"""Greatest grade at the given heights; steeper ones are smoothed."""

_LOWEST_M = 1.0  # everything is over 0, where flat copies of painted lines lie
_STIFF, _LEVEL = 0.03, 1e-3  # weights of bends and of slopes, in cells, beside errors at the given heights
_STIFFER, _TRIES = 8.0, 5  # factor on the weight of bends, as long as the surface is too steep
_COARSENINGS, _ROUNDS = 4, 80  # grids from coarse to fine, each with half the cells, and iterations on each


class Terrain:
    """A surface of triangles on a grid, as near to given heights as a smooth one can be; far from them it is level.

    Attributes:
        triangles: (T, 3, 3) m, counter-clockwise from above.
        steepest: greatest grade at the given heights, m per m.

    Args:
        spots: (N, 3) m, places and heights; only differences of heights matter.
        low: lower corner (2,) m of the ground.
        high: its upper corner.
    """

    def __init__(self, spots: Floats, low: Floats, high: Floats) -> None:
        stiff = _STIFF
        for _ in range(_TRIES):
            heights = _fitted(spots, low, high, stiff)
            self.steepest = _steepest(heights, (spots[:, :2] - low) / CELL_M)
            if self.steepest <= STEEPEST:
                break
            stiff *= _STIFFER
        heights += _LOWEST_M - heights.min()
        at = np.indices(heights.shape).transpose(1, 2, 0) * CELL_M + low
        corners = np.concatenate([at, heights[..., None]], axis=2)
        a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
        self.triangles: Floats = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], 2).reshape(-1, 3, 3)

    @cached_property
    def relief(self) -> Relief:
        """The surface by itself."""
        return Relief(self.triangles)

    def laid(self, triangles: Floats) -> Floats:
        """Cut triangles (T, 3, 3) m over flat ground, counter-clockwise from above, into pieces over this ground."""
        return drape(triangles, self.relief.grid)[len(triangles) :]

    def followed(self, points: Floats) -> Floats:
        """Raise each of points (..., 3 or more) m over flat ground, or boxes, by the height of this ground there."""
        raised = points.copy()
        raised[..., 2] += self.relief.heights(points[..., :2].reshape(-1, 2)).reshape(points.shape[:-1])
        return raised

    def standing(self, part: StaticPart, foot: Floats) -> StaticPart:
        """Raise a part that stands on flat ground by the least height under points (N, 2) m of its foot."""
        rise_m = float(self.relief.heights(foot).min())
        boxes = None if part.boxes is None else part.boxes + rise_m * np.eye(7)[2]
        return replace(part, vertices=part.vertices + np.array([0.0, 0.0, rise_m]), boxes=boxes)

    def along(self, part: StaticPart) -> StaticPart:
        """Raise each point of a part over flat ground by the height of this ground there."""
        boxes = None if part.boxes is None else self.followed(part.boxes)
        return replace(part, vertices=self.followed(part.vertices), boxes=boxes)


def _fitted(spots: Floats, low: Floats, high: Floats, stiff: float) -> Floats:
    """Return heights (I, J) m on a grid from `low` on that reaches `high`: coarse first, then ever finer."""
    cells = np.ceil((high - low) / CELL_M).astype(np.int64)
    heights = np.full((2, 2), spots[:, 2].mean())
    for halvings in range(_COARSENINGS, -1, -1):
        step_m = CELL_M * 2**halvings
        shape = -(-cells // 2**halvings) + 1
        heights = _finer(heights, shape)
        at = (spots[:, :2] - low) / step_m
        _relax(heights, at, np.ascontiguousarray(spots[:, 2]), stiff, _LEVEL, _ROUNDS)
    return heights


def _finer(heights: Floats, shape: Ints) -> Floats:
    """Return heights at twice as many places, at least `shape` (2,) of them, from the same corner on."""
    for axis in (0, 1):
        places = np.minimum(np.arange(shape[axis]) / 2, heights.shape[axis] - 1.0)
        first = np.minimum(places.astype(np.int64), heights.shape[axis] - 2)
        share = (places - first).reshape((-1, 1) if axis == 0 else (1, -1))
        before, after = np.take(heights, first, axis), np.take(heights, first + 1, axis)
        heights = before + share * (after - before)
    return heights


@njit(cache=True, nogil=True)
def _relax(heights: Floats, at: Floats, wanted: Floats, stiff: float, level: float, rounds: int) -> None:
    """Improve heights (I, J) by conjugate gradients (Hestenes and Stiefel 1952) on their weighted squared errors.

    Errors are those from `wanted` (N,) m at places `at` (N, 2) in cells, second differences by `stiff`, and first ones
    by `level`.
    """
    rest = -_gradient(heights, at, wanted, stiff, level)
    way, zero = rest.copy(), np.zeros(len(wanted))
    size = _dot(rest, rest)
    for _ in range(rounds):
        if size < 1e-12:
            return
        change = _gradient(way, at, zero, stiff, level)
        step = size / _dot(way, change)
        heights += step * way
        rest -= step * change
        before, size = size, _dot(rest, rest)
        way = rest + size / before * way


@njit(cache=True, nogil=True)
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            total += a[i, j] * b[i, j]
    return total


@njit(cache=True, nogil=True)
def _gradient(heights: Floats, at: Floats, wanted: Floats, stiff: float, level: float) -> Floats:
    """Return half the gradient (I, J) of the squared errors (see `_relax`)."""
    found, rows, columns = np.zeros_like(heights), heights.shape[0], heights.shape[1]
    for n in range(len(at)):
        i, j, a, b, c = _corner_shares(at[n, 0], at[n, 1], rows, columns)
        k, m = (i + 1, j) if at[n, 0] - i >= at[n, 1] - j else (i, j + 1)
        error = a * heights[i, j] + b * heights[k, m] + c * heights[i + 1, j + 1] - wanted[n]
        found[i, j] += a * error
        found[k, m] += b * error
        found[i + 1, j + 1] += c * error
    for i in range(rows):
        for j in range(columns):
            for di, dj in ((1, 0), (0, 1)):
                if i + di < rows and j + dj < columns:
                    slope = level * (heights[i + di, j + dj] - heights[i, j])
                    found[i + di, j + dj] += slope
                    found[i, j] -= slope
                if i + 2 * di < rows and j + 2 * dj < columns:
                    bend = heights[i, j] - 2 * heights[i + di, j + dj] + heights[i + 2 * di, j + 2 * dj]
                    found[i, j] += stiff * bend
                    found[i + di, j + dj] -= 2 * stiff * bend
                    found[i + 2 * di, j + 2 * dj] += stiff * bend
            if i + 1 < rows and j + 1 < columns:
                twist = heights[i, j] - heights[i + 1, j] - heights[i, j + 1] + heights[i + 1, j + 1]
                found[i, j] += 2 * stiff * twist
                found[i + 1, j] -= 2 * stiff * twist
                found[i, j + 1] -= 2 * stiff * twist
                found[i + 1, j + 1] += 2 * stiff * twist
    return found


@njit(cache=True, nogil=True)
def _corner_shares(x: float, y: float, rows: int, columns: int) -> tuple[int, int, float, float, float]:
    """Return the cell of a place in cells, and the shares of its first, its middle and its last corner there."""
    i, j = min(max(int(x), 0), rows - 2), min(max(int(y), 0), columns - 2)
    u, v = x - i, y - j
    return i, j, 1 - max(u, v), abs(u - v), min(u, v)


@njit(cache=True, nogil=True)
def _steepest(heights: Floats, at: Floats) -> float:
    """Return the greatest grade, m per m, of the triangles under places (N, 2) in cells."""
    most = 0.0
    for n in range(len(at)):
        i, j, _, _, _ = _corner_shares(at[n, 0], at[n, 1], heights.shape[0], heights.shape[1])
        here, far = heights[i, j], heights[i + 1, j + 1]
        if at[n, 0] - i >= at[n, 1] - j:
            dx, dy = heights[i + 1, j] - here, far - heights[i + 1, j]
        else:
            dx, dy = far - heights[i, j + 1], heights[i, j + 1] - here
        most = max(most, np.sqrt(dx * dx + dy * dy) / CELL_M)
    return most
