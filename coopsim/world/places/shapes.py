"""Vertices and faces of plain shapes, to build scenery from: boxes, cylinders and a ball.

They are those of the package trimesh, to the last bit once they are rounded. Its import would take every process longer
than to build a place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_BOX = "130 410 032 240 173 514 571 372 642 276 654 756"
"""Corners of a box's triangles; the bits of a corner's number say on which side it is, of x, y and z."""

_ICOSAHEDRON = "0b5 051 017 07a 0ab 159 5b4 ba2 a76 718 394 342 326 368 389 495 24b 62a 867 981"
"""Corners of the triangles of an icosahedron, as hexadecimal digits."""

_GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0


def box(low: ArrayLike, high: ArrayLike) -> tuple[Floats, Ints]:
    """Return the vertices (8, 3) and faces (12, 3) of an upright block between two corners (3,)."""
    start = np.asarray(low, dtype=np.float64)
    sides = np.arange(8)[:, None] >> np.array([2, 1, 0]) & 1
    return sides * (np.asarray(high, dtype=np.float64) - start) + start, _faces(_BOX)


def cylinder(radius_m: float, height_m: float, sections: int = 32) -> tuple[Floats, Ints]:
    """Return the vertices (2 + 2 N, 3) and faces (4 N, 3) of a cylinder of N sections that stands on the origin."""
    angles_rad = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    rings = np.zeros((1 + sections, 2, 3))  # the first has the middles of both ends
    rings[:, 1, 2] = height_m
    rings[1:, :, :2] = radius_m * np.stack([exact.cos(angles_rad), exact.sin(angles_rad)], axis=1)[:, None]
    order = np.array([0, 2, 3, 1, *range(4, 2 + 2 * sections)])
    low = np.array([1, *range(4, 2 + 2 * sections, 2)])
    high, after = low + 1, np.roll(low, -1)
    foot, top = np.zeros_like(low), np.full_like(low, 3)
    corners = [low, foot, after, low, after, high, high, after, after + 1, high, after + 1, top]
    return exact.settled(rings.reshape(-1, 3)[order]), np.stack(corners, axis=1).reshape(-1, 3)


def ball() -> tuple[Floats, Ints]:
    """Return the vertices (42, 3) and faces (80, 3) of a ball of radius 1: an icosahedron with its edges halved."""
    corners = np.array([[-1.0, _GOLDEN, 0.0], [1.0, _GOLDEN, 0.0], [-1.0, -_GOLDEN, 0.0], [1.0, -_GOLDEN, 0.0]])
    corners = np.concatenate([np.roll(corners, turn, axis=1) for turn in range(3)])
    faces = _faces(_ICOSAHEDRON)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)[..., ::-1]
    edges, middles = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    vertices = np.concatenate([corners, corners[edges].mean(axis=1)])
    (a, b, c), (ab, bc, ca) = faces.T, len(corners) + middles.reshape(-1, 3).T
    halved = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return exact.settled(vertices / exact.norm(vertices, keepdims=True)), halved


def _faces(digits: str) -> Ints:
    return np.array([[int(digit, 16) for digit in face] for face in digits.split()])
