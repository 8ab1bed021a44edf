"""The slow rise and fall of the ground around an agent: a smooth surface under its points.

The lowest points of wide cells are nearly all on the ground. A surface of B-splines is drawn through them by least
squares in which points above it count little (asymmetric least squares: Eilers and Boelens 2005, "Baseline correction
with asymmetric least squares smoothing"), and stays at the agent's own ground where there are none. It is taken where
flat ground explains clearly fewer of the lowest points: in a flat place it would only climb distant things.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

_CELL_M, _CELLS = 6.4, 33  # cells of minima: to 105.6 m on each side
_KNOT_M = 25.6  # hills of 50 m and more
_BENT, _FLAT = 0.3, 0.1  # weights of second differences of the splines' numbers, and of their squares
_ABOVE, _BELOW = 0.0003, 0.01  # weights of minima far above the surface (things without ground beside) and far below it
_NEAR_M, _LESS = 0.15, 0.6  # lowest points are rather above the ground than below
_GRADE = 0.06  # up to which first minima are believed: steep for a street
_TOLERANCES = (1.0, 0.5), (0.3, 0.1)  # of each round of minima, as shares of that grade
_OWN = slice(_CELLS // 2 - 1, _CELLS // 2 + 2)  # the agent stands there
# On 34 flat sweeps the share is .85 to 1.07, on hilly ones up to .84 unless they are nearly flat.
_ON_M, _AS_GOOD = 0.2, 0.83
_ENOUGH = 30_000  # points of which the lowest are sought
_LOW = -_CELL_M * _CELLS / 2


def surface(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the height (P,) m of the ground's surface under each of the points (P, >= 3) x, y, z m; zeros if flat.

    The agent is at the origin, and the ground under it at z = 0. Beyond 105 m the ground stays as high as at the rim.
    """
    heights = np.zeros((_CELLS, _CELLS), np.float32)
    splines, penalty, far_m = _splines()
    few = np.ascontiguousarray(points[:: max(1, len(points) // _ENOUGH)])
    for tolerances in _TOLERANCES:
        above = _minima(few, heights)
        above[_OWN, _OWN] = -heights[_OWN, _OWN]
        known, target = np.isfinite(above), above + heights
        for tolerance in tolerances:
            away, near = target - heights, _NEAR_M + tolerance * _GRADE * far_m
            weight = np.where(away > _LESS * near, _ABOVE, np.where(away < -near, _BELOW, 1.0)) * known
            number = _fitted(np.where(known, target, 0.0), weight, splines, penalty)
            heights = (splines @ number @ splines.T).astype(np.float32)
    on_flat, on_surface = (np.count_nonzero(np.abs(_minima(few, each)) < _ON_M) for each in (0 * heights, heights))
    return np.zeros(len(points), np.float32) if on_flat > _AS_GOOD * on_surface else between(points, heights, _CELL_M)


@cache
def _splines() -> tuple[Floats, Floats, Floats]:
    """Return the K splines along an axis at its cells (N, K), the penalty (K^2, K^2), and distances (N, N) m."""
    at = _LOW + (np.arange(_CELLS) + 0.5) * _CELL_M
    last = round(-_LOW / _KNOT_M) + 1
    knots = np.arange(-last, last + 1) * _KNOT_M
    away = np.abs(at[:, None] - knots) / _KNOT_M
    splines = np.where(away < 1, 2 / 3 - away**2 + away**3 / 2, np.where(away < 2, (2 - away) ** 3 / 6, 0.0))
    bend, eye = np.diff(np.eye(len(knots)), 2, axis=0), np.eye(len(knots))
    penalty = _BENT * (np.kron(bend.T @ bend, eye) + np.kron(eye, bend.T @ bend)) + _FLAT * np.eye(len(knots) ** 2)
    return splines, penalty, np.hypot(at[:, None], at)


@njit(cache=True, nogil=True)
def _fitted(target, weight, splines, penalty):  # type: ignore[no-untyped-def]
    """Return the splines' numbers (K, K) of the least weighted squares: normal equations, by Cholesky."""
    count = splines.shape[1]
    matrix, right = penalty.copy(), np.zeros(count * count)
    rows, values = np.empty(25, np.int64), np.empty(25)  # a cell lies in at most 4 x 4 splines
    for i in range(len(splines)):
        for j in range(len(splines)):
            if weight[i, j] == 0:
                continue
            found = 0
            for a in range(count):
                for b in range(count):
                    if splines[i, a] > 0 and splines[j, b] > 0:
                        rows[found], values[found] = a * count + b, splines[i, a] * splines[j, b]
                        found += 1
            for a in range(found):
                right[rows[a]] += weight[i, j] * values[a] * target[i, j]
                for b in range(found):
                    matrix[rows[a], rows[b]] += weight[i, j] * values[a] * values[b]
    last = 3 * count + 3  # farther apart, two splines do not meet: the matrix is a band, and so is its root
    for k in range(len(right)):
        first = max(0, k - last)
        for j in range(first, k + 1):
            total = matrix[k, j]
            for m in range(first, j):
                total -= matrix[k, m] * matrix[j, m]
            matrix[k, j] = np.sqrt(total) if j == k else total / matrix[j, j]
        for m in range(first, k):
            right[k] -= matrix[k, m] * right[m]
        right[k] /= matrix[k, k]
    for k in range(len(right) - 1, -1, -1):
        for j in range(k + 1, min(len(right), k + last + 1)):
            right[k] -= matrix[j, k] * right[j]
        right[k] /= matrix[k, k]
    return right.reshape(count, count)


@njit(cache=True, nogil=True)
def between(points, heights, cell_m):  # type: ignore[no-untyped-def]
    """Return a square surface around the agent at points (P,), between the middles of its cells."""
    out, first_m, last = np.empty(len(points), np.float32), -cell_m * len(heights) / 2, len(heights) - 1.001
    for k in range(len(points)):
        row = min(max((points[k, 1] - first_m) / cell_m - 0.5, 0.0), last)
        column = min(max((points[k, 0] - first_m) / cell_m - 0.5, 0.0), last)
        i, j = int(row), int(column)
        a, b = row - i, column - j
        low = (1 - b) * heights[i, j] + b * heights[i, j + 1]
        out[k] = (1 - a) * low + a * ((1 - b) * heights[i + 1, j] + b * heights[i + 1, j + 1])
    return out


@njit(cache=True, nogil=True)
def _minima(points, heights):  # type: ignore[no-untyped-def]
    """Return the least height of points above a surface in each cell; infinity: it has none."""
    lowest = np.full((_CELLS, _CELLS), np.float32(np.inf))
    above = points[:, 2] - between(points, heights, _CELL_M)
    for k in range(len(points)):
        i, j = int(np.floor((points[k, 1] - _LOW) / _CELL_M)), int(np.floor((points[k, 0] - _LOW) / _CELL_M))
        if 0 <= i < _CELLS and 0 <= j < _CELLS:
            lowest[i, j] = min(lowest[i, j], above[k])
    return lowest
