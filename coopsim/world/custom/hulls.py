"""Upright bodies on convex outlines, and the boxes around them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints


def prism(outline: Floats, low_m: float, high_m: float) -> tuple[Floats, Ints]:
    """Return vertices and faces of walls on a convex outline (K, 2) m, counter-clockwise, with floor and roof."""
    count = len(outline)
    vertices = np.empty((2 * count, 3))
    vertices[:count, :2] = vertices[count:, :2] = outline
    vertices[:count, 2], vertices[count:, 2] = low_m, high_m
    return vertices, _prism_faces(count)


@njit(cache=True, nogil=True)
def box_around(outline: Floats, low_m: float, high_m: float) -> Floats:
    """Return the box (7,) over the smallest rectangle around a convex outline (K, 2) m, from one height to another.

    One side of that rectangle lies along one of the outline (Freeman and Shapira 1975).
    """
    best, least_m2 = np.zeros(7), np.inf
    for k in range(len(outline)):
        edge = outline[(k + 1) % len(outline)] - outline[k]
        cos, sin = edge / np.hypot(edge[0], edge[1])
        along, aside = outline[:, 0] * cos + outline[:, 1] * sin, outline[:, 1] * cos - outline[:, 0] * sin
        x, y = (along.min() + along.max()) / 2, (aside.min() + aside.max()) / 2
        length_m, width_m = along.max() - along.min(), aside.max() - aside.min()
        if length_m * width_m < least_m2:
            least_m2 = length_m * width_m
            best[0], best[1], best[2] = x * cos - y * sin, x * sin + y * cos, (low_m + high_m) / 2
            best[3], best[4], best[5] = length_m, width_m, high_m - low_m
            best[6] = np.arctan2(sin, cos)
    return best


@lru_cache(maxsize=32)
def _prism_faces(count: int) -> Ints:
    here, fan = np.arange(count), np.arange(1, count - 1)
    there = np.roll(here, -1)
    faces = np.vstack(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
            np.column_stack([np.zeros_like(fan), fan + 1, fan]),
            np.column_stack([np.full_like(fan, count), fan + count, fan + 1 + count]),
        ]
    )
    faces.setflags(write=False)
    return faces
