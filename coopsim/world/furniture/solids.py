"""Materials, closed solids and pieces that furniture is built from.

Frame of a model: x ahead (where its front looks), y to the left, z up from the ground, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints


class Material(NamedTuple):
    """Surface: RGB colour, and reflectivity at 905 nm."""

    color: tuple[int, int, int]
    reflectivity: float


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Mesh of vertices (V, 3) m and faces (F, 3), counter-clockwise from outside."""

    vertices: Floats
    faces: Ints


def prism(low: ArrayLike, high: ArrayLike) -> Solid:
    """Join two outlines (K, 3) m, counter-clockwise from the side of `high`, each flat and convex; 4 K - 4 faces."""
    bottom, top = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return Solid(np.vstack([bottom, top]), _prism_faces(len(bottom)))


@lru_cache
def _prism_faces(count: int) -> Ints:
    """Return the faces (4 K - 4, 3) of a prism over K corners; not to be changed."""
    here, fan = np.arange(count), np.arange(1, count - 1)
    there, zero = np.roll(here, -1), np.zeros(count - 2, dtype=np.int64)
    faces = [
        np.column_stack([here, there, there + count]),
        np.column_stack([here, there + count, here + count]),
        np.column_stack([zero, fan + 1, fan]),
        np.column_stack([zero + count, fan + count, fan + 1 + count]),
    ]
    return np.vstack(faces)


def block(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], taper: float = 1.0) -> Solid:
    """Build an upright block (12 faces); `taper` is the top's share of the bottom's size."""
    corners = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
    middle = corners.mean(axis=0)
    return prism(_at(corners, z[0]), _at(middle + taper * (corners - middle), z[1]))


def bar(start: ArrayLike, end: ArrayLike, radius_m: float, end_radius_m: float | None = None, sides: int = 6) -> Solid:
    """Build a round bar from one point (3,) m to another, 4 `sides` - 4 faces; its radius may change along it."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = (b - a) / exact.norm(b - a)
    aside = _cross(along, np.array([0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0]))
    aside /= exact.norm(aside)
    turn = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    ring = exact.cos(turn)[:, None] * aside + exact.sin(turn)[:, None] * _cross(along, aside)
    return prism(a + radius_m * ring, b + (radius_m if end_radius_m is None else end_radius_m) * ring)


def post(x: float, y: float, z: tuple[float, float], radius_m: float, top_m: float | None = None) -> Solid:
    """Build an upright round post (20 faces)."""
    return bar((x, y, z[0]), (x, y, z[1]), radius_m, top_m)


def drum(x: float, y: float, z: tuple[float, float], radius_m: float, top_m: float | None = None) -> Solid:
    """Build an upright round body (28 faces)."""
    return bar((x, y, z[0]), (x, y, z[1]), radius_m, top_m, sides=8)


def mound(rings: Sequence[Floats]) -> Solid:
    """Build a body through level outlines (K, 3) m from below, counter-clockwise from above, with a flat top."""
    count, levels = len(rings[0]), len(rings)
    here = np.arange(count)
    there, fan = np.roll(here, -1), np.arange(1, count - 1)
    zero, last = np.zeros(count - 2, dtype=np.int64), (levels - 1) * count
    sides = [
        np.column_stack([a + k * count, b + k * count, c + k * count])
        for k in range(levels - 1)
        for a, b, c in ((here, there, there + count), (here, there + count, here + count))
    ]
    caps = [np.column_stack([zero, fan + 1, fan]), np.column_stack([zero, fan, fan + 1]) + last]
    return Solid(np.vstack(rings), np.vstack([*sides, *caps]))


def sheet(corners: ArrayLike) -> Solid:
    """Build a rectangle without thickness from its corners (4, 3) m (2 faces)."""
    return Solid(np.array(corners, dtype=np.float64), np.array([[0, 1, 2], [0, 2, 3]]))


def joined(solids: Sequence[Solid]) -> Solid:
    """Return all solids as one mesh."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    faces = [solid.faces + start for solid, start in zip(solids, starts, strict=False)]
    return Solid(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross product of two vectors (3,), ten times as fast as numpy, which takes any shapes."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _at(outline: Floats, z: float) -> Floats:
    return np.column_stack([outline, np.full(len(outline), z)])


_HIDING_M = 0.3
"""Narrower and lower solids hide too little of a person to count where no rays are cast."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Part of a piece, made of one material.

    Attributes:
        vertices: (V, 3) m; x ahead, y to the left, z up from the ground.
        faces: (F, 3) int.
        material: surface.
        closed: True if the faces enclose a volume; else both of their sides are seen.
        boxes: (K, 7) upright boxes that hide objects behind them, where no rays are cast.
        opacity: share of the light through a box that is stopped.
    """

    vertices: Floats
    faces: Ints
    material: Material
    closed: bool
    boxes: Floats
    opacity: float = 1.0


Piece = tuple[Shape, ...]


def shape(material: Material, *solids: Solid) -> Shape:
    """Join closed solids of one material; each that is large enough hides objects behind it."""
    mesh = joined(solids)
    boxes = [box for box in (box_around(solid.vertices) for solid in solids) if box[3:5].max() >= _HIDING_M <= box[5]]
    return Shape(mesh.vertices, mesh.faces, material, True, np.array(boxes).reshape(-1, 7))


def box_around(points: Floats) -> Floats:
    """Return the upright box (7,) around points (N, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([*(low + high) / 2, *(high - low), 0.0])
