"""What lies on the ground: flat triangles laid over a relief."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.world.relief.relief_grid import ReliefGrid, height_at, span_of
from coopsim.world.snapshot import StaticPart

_MOST_CORNERS = 9
_LEAST_M2 = 1e-6  # of a piece


def laid_on(part: StaticPart, grid: ReliefGrid, up_m: float) -> StaticPart:
    """Return a flat part as it lies on the ground, `up_m` over it."""
    laid = drape(np.ascontiguousarray(part.vertices[part.faces][..., :2]), grid)
    vertices = laid.reshape(-1, 3) + np.array([0.0, 0.0, up_m])
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return replace(part, vertices=vertices, faces=faces, closed=False)


def drape(flat: Floats, grid: ReliefGrid) -> Floats:
    """Return flat triangles and, of each surface below them, the piece that lies on it: (M, 3, 3) m.

    The flat ones stay, at height 0: they are seen where nothing is raised.

    Args:
        flat: (N, 3, 2) m, counter-clockwise from above.
        grid: surfaces of the ground.
    """
    pieces = np.zeros((64 + 8 * len(flat), 3, 3))
    pieces[: len(flat), :, :2] = flat
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
                    count = _add_fan(pieces, count, cut, corners, grid.triangles[below])
    return count


@njit(cache=True, nogil=True)
def _add_fan(pieces: Floats, count: int, corners: Floats, number: int, surface: Floats) -> int:
    """Append the triangles of a convex polygon at the heights of a surface (3, 3); return the new number of pieces.

    Where there is no room for them they are only counted.
    """
    for k in range(2, number):
        for row in range(3 if count < len(pieces) else 0):
            corner = 0 if row == 0 else k - 2 + row
            x, y = corners[corner, 0], corners[corner, 1]
            pieces[count, row, 0], pieces[count, row, 1] = x, y
            pieces[count, row, 2] = height_at(surface, x, y)
        count += 1
    return count


@njit(cache=True, nogil=True)
def _cut(flat: Floats, surface: Floats, cut: Floats, spare: Floats) -> int:
    """Fill `cut` with the corners of what two triangles share (Sutherland and Hodgman 1974); return their number."""
    cut[:3] = flat
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
