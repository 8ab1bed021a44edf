"""Surfaces as sensors see them: materials of the faces of models, and the albedo of what is wet."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.world.models.model import DARK

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
GLASS = Surface(0.0, 0.08)
TYRE = Surface(0.0, 0.12, (28, 28, 30))
RIM = Surface(0.0, 0.4, (74, 76, 80))
PLASTIC = Surface(0.0, 0.15, (44, 46, 50))
METAL = Surface(0.0, 0.45, (120, 123, 128))
HEADLIGHT = Surface(0.0, 0.8, (236, 238, 232))
TAILLIGHT = Surface(0.0, 0.9, (170, 22, 24))
"""Reflectivities are round numbers of the order of measured ones: glass and rubber return little, rear lights, which
contain reflectors, much."""


WATER_INDEX = 1.33
"""Refractive index of water."""


@njit(cache=True, nogil=True)
def wet_albedo(albedo: Floats) -> Floats:
    """Return the albedo, in [0, 1], of a matt surface under a film of water, from its dry one.

    The film reflects part of the light that the surface throws back down onto it again, so that an albedo A becomes
    A / (n^2 (1 - A) + A) (Angstrom 1925, as in Lekner and Dorf, "Why some things are darker when wet", 1988).
    """
    square = WATER_INDEX * WATER_INDEX
    wet: Floats = albedo / (square * (1.0 - albedo) + albedo)
    return wet
