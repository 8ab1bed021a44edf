"""A piece of furniture: shapes of one material each, in the model's own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.furniture.materials import Material
from coopsim.world.furniture.solids import Solid, joined

_HIDING_M = 0.3
"""Narrower and lower solids hide too little of a person to count where no rays are cast."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The part of a piece that is of one material.

    Attributes:
        vertices: (V, 3) m; x ahead, y to the left, z up from the ground.
        faces: (F, 3) int.
        material: its surface.
        closed: whether the faces enclose a volume; else both of their sides are seen.
        boxes: (K, 7) upright boxes that hide what is behind, where no rays are cast.
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
    """Join closed solids of one material; each that is large enough hides what is behind it."""
    mesh = joined(solids)
    boxes = [box for box in (box_around(solid.vertices) for solid in solids) if _hides(box)]
    return Shape(mesh.vertices, mesh.faces, material, True, np.array(boxes).reshape(-1, 7))


def box_around(points: Floats) -> Floats:
    """Return the upright box (7,) around points (N, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([*(low + high) / 2, *(high - low), 0.0])


def _hides(box: Floats) -> bool:
    return bool(max(box[3], box[4]) >= _HIDING_M and box[5] >= _HIDING_M)
