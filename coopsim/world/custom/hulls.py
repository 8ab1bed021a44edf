"""Upright bodies on convex outlines, and the boxes around them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from coopsim.geometry.se3 import Floats
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
    edges = np.concatenate([outline[1:], outline[:1]]) - outline
    edges = edges / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    along = edges @ outline.T  # (K, K)
    aside = np.column_stack([-edges[:, 1], edges[:, 0]]) @ outline.T
    low, high = (np.column_stack([end(along, axis=1), end(aside, axis=1)]) for end in (np.min, np.max))
    best = (high - low).prod(axis=1).argmin()
    (cos, sin), (x, y) = edges[best], (low + high)[best] / 2
    size = (high - low)[best]
    middle = [x * cos - y * sin, x * sin + y * cos, (low_m + high_m) / 2]
    return np.array([*middle, *size, high_m - low_m, np.arctan2(sin, cos)])


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
