"""Triangles of the ground by cells of a grid: heights of points, and flat parts laid on them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.snapshot import StaticPart

CELL_M = 4.0
_TOUCH_M = 1e-6  # a point this far outside a triangle is on its edge


class ReliefGrid(NamedTuple):
    """Triangles by cell.

    Attributes:
        triangles: (T, 3, 3) m, counter-clockwise from above, none of them upright.
        low: (2,) m, lower corner of the first cell.
        cells: (2,) number of cells along x and y.
        start: (C + 1,) first entry in `found` of each cell, rows of equal x one after the other.
        found: (F,) indices of the triangles over the cells.
    """

    triangles: Floats
    low: Floats
    cells: Ints
    start: Ints
    found: Ints


def grid_of(triangles: Floats) -> ReliefGrid:
    """Sort triangles (T, 3, 3) m, counter-clockwise from above, into the cells that are partly inside of all edges."""
    triangles = np.ascontiguousarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
    corners = triangles[..., :2].copy()
    low, high = (corners.min(axis=(0, 1)), corners.max(axis=(0, 1))) if len(corners) else np.zeros((2, 2))
    cells = np.floor((high - low) / CELL_M).astype(np.int64) + 1
    first = np.maximum(np.floor((corners.min(axis=1) - _TOUCH_M - low) / CELL_M).astype(np.int64), 0)
    last = np.minimum(np.floor((corners.max(axis=1) + _TOUCH_M - low) / CELL_M).astype(np.int64), cells - 1)
    rows, columns = (last - first + 1).T
    found, place = numbered(rows * columns)
    cell = first[found] + np.column_stack([place // columns[found], place % columns[found]])
    at, meets = low + cell * CELL_M, np.ones(len(found), np.bool_)
    for k in range(3):
        here, there = corners[found, k], corners[found, (k + 1) % 3]
        (ex, ey), ahead = (there - here).T, there > here
        # The cell's corner that is farthest to the left of the edge.
        left_x = np.where(ahead[:, 1], at[:, 0], at[:, 0] + CELL_M)
        left_y = np.where(ahead[:, 0], at[:, 1] + CELL_M, at[:, 1])
        left = ex * (left_y - here[:, 1]) - ey * (left_x - here[:, 0])
        meets &= left + _TOUCH_M * (np.abs(ex) + np.abs(ey)) >= 0
    number = cell[meets, 0] * cells[1] + cell[meets, 1]
    start = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=int(cells.prod())))])
    return ReliefGrid(triangles, low, cells, start, found[meets][np.argsort(number, kind="stable")])


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
    for k in range(3):
        ex, ey = triangle[(k + 1) % 3, 0] - triangle[k, 0], triangle[(k + 1) % 3, 1] - triangle[k, 1]
        left = ex * (y - triangle[k, 1]) - ey * (x - triangle[k, 0])
        if left + _TOUCH_M * (abs(ex) + abs(ey)) < 0:
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


class Relief:
    """Ground that is flat, at 0, except for raised surfaces.

    Where surfaces lie over each other the highest one counts, as for a ray from above. The triangles (T, 3, 3) m, world
    frame, are counter-clockwise from above, none of them upright; `grid` has them by place.
    """

    def __init__(self, triangles: Floats) -> None:
        self.grid = grid_of(triangles)

    def heights(self, points: Floats) -> Floats:
        """Return the heights (N,) m of the ground at points (N, 2) m in the world frame."""
        heights: Floats = _heights(np.ascontiguousarray(points, dtype=np.float64), self.grid)
        return heights

    def raised(self, pose: SE3) -> SE3:
        """Return a pose over flat ground raised by the height of this ground."""
        x, y, z = pose.translation.tolist()
        return SE3(pose.rotation, np.array([x, y, z + self.heights(np.array([[x, y]]))[0]]))


@njit(cache=True, nogil=True)
def _heights(points: Floats, grid: ReliefGrid) -> Floats:
    """Return the highest surface's heights (N,) at points (N, 2), at least 0."""
    heights, rows, columns = np.zeros(len(points)), grid.cells[0], grid.cells[1]
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        i, j = np.floor((x - grid.low[0]) / CELL_M), np.floor((y - grid.low[1]) / CELL_M)
        if not (0 <= i < rows and 0 <= j < columns):  # nor is NaN within
            continue
        cell = int(i) * columns + int(j)
        for k in range(grid.start[cell], grid.start[cell + 1]):
            triangle = grid.triangles[grid.found[k]]
            if is_over(triangle, x, y):
                heights[n] = max(heights[n], height_at(triangle, x, y))
    return heights


_MOST_CORNERS = 9
_LEAST_M2 = 1e-6  # of a piece


def laid_on(part: StaticPart, grid: ReliefGrid, up_m: float) -> StaticPart:
    """Lay a flat part on the ground, `up_m` over it."""
    return with_triangles(part, drape(part.vertices[part.faces] * [1.0, 1.0, 0.0], grid) + np.array([0.0, 0.0, up_m]))


def with_triangles(part: StaticPart, triangles: Floats) -> StaticPart:
    """Return a part with other triangles (T, 3, 3) m."""
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return replace(part, vertices=triangles.reshape(-1, 3), faces=faces, closed=False)


def drape(flat: Floats, grid: ReliefGrid) -> Floats:
    """Return triangles (N, 3, 3) m and, for each surface below them, the piece that lies on it: (M, 3, 3) m.

    Triangles are counter-clockwise from above. Pieces lie as far over the surface as the triangles over 0. The
    triangles come first as they are: they are seen where nothing is raised.
    """
    pieces = np.zeros((64 + 8 * len(flat), 3, 3))
    pieces[: len(flat)] = flat
    while (count := _laid(flat, grid, pieces)) > len(pieces):
        pieces = np.concatenate([pieces[: len(flat)], np.zeros((count - len(flat), 3, 3))])
    return pieces[:count]


@njit(cache=True, nogil=True)
def _laid(flat: Floats, grid: ReliefGrid, pieces: Floats) -> int:
    """Fill `pieces` (P, 3, 3), behind the flat ones, as far as it reaches; return the number of all."""
    count = len(flat)
    seen = np.full(len(grid.triangles), -1, np.int64)
    cut, spare = np.empty((_MOST_CORNERS, 2)), np.empty((_MOST_CORNERS, 2))
    for n in range(len(flat)):
        first_i, last_i, first_j, last_j = span_of(flat[n], grid.low, grid.cells)
        for i in range(first_i, last_i + 1):
            for j in range(first_j, last_j + 1):
                cell = i * grid.cells[1] + j
                for k in range(grid.start[cell], grid.start[cell + 1]):
                    below = grid.found[k]
                    if seen[below] == n:
                        continue
                    seen[below] = n
                    corners = _cut(flat[n], grid.triangles[below], cut, spare)
                    count = _add_fan(pieces, count, cut, corners, grid.triangles[below], flat[n])
    return count


@njit(cache=True, nogil=True)
def _add_fan(pieces: Floats, count: int, corners: Floats, number: int, surface: Floats, own: Floats) -> int:
    """Append the triangles of a convex polygon at the heights of a surface (3, 3), and of their own triangle over it.

    Return the new number of pieces.

    Where there is no room for them they are only counted.
    """
    for k in range(2, number):
        for row in range(3 if count < len(pieces) else 0):
            corner = 0 if row == 0 else k - 2 + row
            x, y = corners[corner, 0], corners[corner, 1]
            pieces[count, row, 0], pieces[count, row, 1] = x, y
            pieces[count, row, 2] = height_at(surface, x, y) + height_at(own, x, y)
        count += 1
    return count


@njit(cache=True, nogil=True)
def _cut(flat: Floats, surface: Floats, cut: Floats, spare: Floats) -> int:
    """Fill `cut` with the corners of the intersection of two triangles; return their number.

    The method is Sutherland's and Hodgman's (1974).
    """
    cut[:3] = flat[:, :2]
    corners = 3
    for k in range(3):
        after, kept = (k + 1) % 3, 0
        ex, ey = surface[after, 0] - surface[k, 0], surface[after, 1] - surface[k, 1]
        for c in range(corners):
            here, there = cut[c], cut[(c + 1) % corners]
            p = ex * (here[1] - surface[k, 1]) - ey * (here[0] - surface[k, 0])
            q = ex * (there[1] - surface[k, 1]) - ey * (there[0] - surface[k, 0])
            if p >= 0:
                spare[kept] = here
                kept += 1
            if (p > 0 and q < 0) or (p < 0 and q > 0):
                share = p / (p - q)
                spare[kept, 0] = here[0] + share * (there[0] - here[0])
                spare[kept, 1] = here[1] + share * (there[1] - here[1])
                kept += 1
        corners = kept
        for c in range(corners):
            cut[c] = spare[c]
    return corners if _area(cut, corners) > _LEAST_M2 else 0


@njit(cache=True, nogil=True)
def _area(corners: Floats, number: int) -> float:
    """Return the area within the first `number` corners of a polygon, counter-clockwise."""
    area = 0.0
    for k in range(number):
        here, there = corners[k], corners[(k + 1) % number]
        area += here[0] * there[1] - here[1] * there[0]
    return area / 2
