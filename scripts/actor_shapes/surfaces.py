"""Materials of the faces of models."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.world.models.model import DARK
from coopsim.world.models.surfaces import GLASS_REFLECTIVITY

RGB = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Surface:
    """Material of a face.

    Attributes:
        tint: share of the actor's paint in its colour.
        reflectivity: at 905 nm.
        color: the face's own.
        accented: the face takes the actor's second colour.
    """

    tint: float
    reflectivity: float
    color: RGB = DARK
    accented: bool = False


PAINT = Surface(1.0, 0.55)
ACCENT = Surface(1.0, 0.55, accented=True)
GLASS = Surface(0.0, GLASS_REFLECTIVITY)
TYRE = Surface(0.0, 0.12, (28, 28, 30))
RIM = Surface(0.0, 0.4, (74, 76, 80))
PLASTIC = Surface(0.0, 0.15, (44, 46, 50))
METAL = Surface(0.0, 0.45, (120, 123, 128))
HEADLIGHT = Surface(0.0, 0.8, (236, 238, 232))
TAILLIGHT = Surface(0.0, 0.9, (170, 22, 24))
"""Reflectivities are round numbers of the order of measured ones: glass and rubber return little, rear lights, which
contain reflectors, much."""
