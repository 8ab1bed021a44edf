"""Surfaces as sensors see them: panes, by their reflectivity, and the albedo of what is wet."""

from __future__ import annotations

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

GLASS_REFLECTIVITY = 0.08
"""Reflectivity of panes of models at 905 nm; no other face of a vehicle has it."""

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
