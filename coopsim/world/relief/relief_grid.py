"""Triangles seen from above, by the square cells that they are over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

CELL_M = 4.0
_TOUCH_M = 1e-6  # a point this far outside a triangle is on its edge


class ReliefGrid(NamedTuple):
    """Triangles by cell.

    Attributes:
        triangles: (T, 3, 3) m, counter-clockwise from above, none of them upright.
        low: (2,) m, the first cell's lower corner.
        cells: (2,) number of cells along x and y.
        start: (C + 1,) first entry in `found` of each cell, rows of equal x one after the other.
        found: (F,) the triangles over the cells.
    """

    triangles: Floats
    low: Floats
    cells: Ints
    start: Ints
    found: Ints


def grid_of(triangles: Floats) -> ReliefGrid:
    """Sort triangles (T, 3, 3) m, counter-clockwise from above, into cells."""
    triangles = np.ascontiguousarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
    corners = triangles.reshape(-1, 3)[:, :2] if len(triangles) else np.zeros((1, 2))
    low = corners.min(axis=0)
    cells = np.floor((corners.max(axis=0) - low) / CELL_M).astype(np.int64) + 1
    return ReliefGrid(triangles, low, cells, *_sort(triangles, low, cells))


@njit(cache=True, nogil=True)
def span_of(triangle: Floats, low: Floats, cells: Ints) -> tuple[int, int, int, int]:
    """Return the cells around the corners (3, 2 or 3) of a triangle: first and last along x, first and last along y."""
    i = int(np.floor((triangle[:, 0].min() - _TOUCH_M - low[0]) / CELL_M))
    j = int(np.floor((triangle[:, 1].min() - _TOUCH_M - low[1]) / CELL_M))
    last_i = int(np.floor((triangle[:, 0].max() + _TOUCH_M - low[0]) / CELL_M))
    last_j = int(np.floor((triangle[:, 1].max() + _TOUCH_M - low[1]) / CELL_M))
    return max(i, 0), min(last_i, cells[0] - 1), max(j, 0), min(last_j, cells[1] - 1)


@njit(cache=True, nogil=True)
def is_over(triangle: Floats, x: float, y: float) -> bool:
    """Return whether a triangle is over a place, its edges included."""
    for k in range(3):  # noqa: SIM110  (numba takes no generators)
        if _left_of(triangle, k, x, y) < 0:
            return False
    return True


@njit(cache=True, nogil=True)
def height_at(triangle: Floats, x: float, y: float) -> float:
    """Return the height at a place of the plane through a triangle."""
    ux, uy = triangle[1, 0] - triangle[0, 0], triangle[1, 1] - triangle[0, 1]
    vx, vy = triangle[2, 0] - triangle[0, 0], triangle[2, 1] - triangle[0, 1]
    px, py = x - triangle[0, 0], y - triangle[0, 1]
    u, v = (px * vy - py * vx) / (ux * vy - uy * vx), (ux * py - uy * px) / (ux * vy - uy * vx)
    along_u, along_v = triangle[1, 2] - triangle[0, 2], triangle[2, 2] - triangle[0, 2]
    return float(triangle[0, 2] + u * along_u + v * along_v)


@njit(cache=True, nogil=True)
def _sort(triangles: Floats, low: Floats, cells: Ints) -> tuple[Ints, Ints]:
    """Return the first entry (C + 1,) of each cell, and the entries: first they are counted, then filled in."""
    filled = np.zeros(cells[0] * cells[1] + 1, np.int64)
    found = np.empty(0, np.int64)
    for filling in (False, True):
        for t in range(len(triangles)):
            first_i, last_i, first_j, last_j = span_of(triangles[t], low, cells)
            for i in range(first_i, last_i + 1):
                for j in range(first_j, last_j + 1):
                    if not _meets(triangles[t], low[0] + i * CELL_M, low[1] + j * CELL_M):
                        continue
                    cell = i * cells[1] + j
                    if filling:
                        found[filled[cell]] = t
                    filled[cell + (not filling)] += 1
        if not filling:
            for cell in range(len(filled) - 1):
                filled[cell + 1] += filled[cell]
            start, found = filled.copy(), np.empty(filled[-1], np.int64)
    return start, found


@njit(cache=True, nogil=True)
def _meets(triangle: Floats, x: float, y: float) -> bool:
    """Return whether a cell with its lower corner at x, y is at least partly on the inner side of each edge."""
    for k in range(3):
        after = (k + 1) % 3
        # The cell's corner that is farthest to the left of the edge.
        left_x = x if triangle[after, 1] > triangle[k, 1] else x + CELL_M
        left_y = y + CELL_M if triangle[after, 0] > triangle[k, 0] else y
        if _left_of(triangle, k, left_x, left_y) < 0:
            return False
    return True


@njit(cache=True, nogil=True)
def _left_of(triangle: Floats, k: int, x: float, y: float) -> float:
    """Return a number that is negative where a place is clearly to the right of a triangle's edge k."""
    ex, ey = triangle[(k + 1) % 3, 0] - triangle[k, 0], triangle[(k + 1) % 3, 1] - triangle[k, 1]
    left = ex * (y - triangle[k, 1]) - ey * (x - triangle[k, 0])
    return float(left + _TOUCH_M * (abs(ex) + abs(ey)))
