"""Upright bodies on convex outlines, and the boxes around them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints


def prism(outline: Floats, low_m: float, high_m: float) -> tuple[Floats, Ints]:
    """Return vertices and faces of walls on a convex outline (K, 2) m, counter-clockwise, with floor and roof."""
    count = len(outline)
    vertices = np.empty((2 * count, 3))
    vertices[:count, :2] = vertices[count:, :2] = outline
    vertices[:count, 2], vertices[count:, 2] = low_m, high_m
    return vertices, _prism_faces(count)


def box_around(outline: Floats, low_m: float, high_m: float) -> Floats:
    """Return the box (7,) over the smallest rectangle around a convex outline (K, 2) m, from one height to another.

    One side of that rectangle lies along one of the outline (Freeman and Shapira 1975).
    """
    return _box_around(np.ascontiguousarray(outline), low_m, high_m)


@njit(cache=True, nogil=True)
def _box_around(outline: Floats, low_m: float, high_m: float) -> Floats:
    best, least_m2 = np.zeros(7), np.inf
    for k in range(len(outline)):
        after = (k + 1) % len(outline)
        edge_x, edge_y = outline[after, 0] - outline[k, 0], outline[after, 1] - outline[k, 1]
        edge_m = exact.hypot(edge_x, edge_y)
        cos, sin = edge_x / edge_m, edge_y / edge_m
        first, last, right, left = np.inf, -np.inf, np.inf, -np.inf
        for n in range(len(outline)):
            along, aside = outline[n, 0] * cos + outline[n, 1] * sin, outline[n, 1] * cos - outline[n, 0] * sin
            first, last, right, left = min(first, along), max(last, along), min(right, aside), max(left, aside)
        x, y, length_m, width_m = (first + last) / 2, (right + left) / 2, last - first, left - right
        if length_m * width_m < least_m2:
            least_m2 = length_m * width_m
            best[0], best[1], best[2] = x * cos - y * sin, x * sin + y * cos, (low_m + high_m) / 2
            best[3], best[4], best[5] = length_m, width_m, high_m - low_m
            best[6] = exact.arctan2(sin, cos)
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
