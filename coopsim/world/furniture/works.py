"""What is left or put up in streets for a while: heaps, trailers."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.support.rng import stream
from coopsim.world.furniture.materials import BLUE, DARK_METAL, EARTH, GREY, RUBBER, RUBBLE, SAND, WHITE
from coopsim.world.furniture.piece import Piece, shape
from coopsim.world.furniture.solids import bar, block, mound

_LOADS = (SAND, RUBBLE, EARTH)


def heap(width_m: float, height_m: float, variant: int) -> Piece:
    """Build a heap of sand, rubble or earth, of uneven outline."""
    draws = stream(variant, "heap")
    angle = np.arange(9) * 2 * np.pi / 9
    uneven = draws.uniform(0.8, 1.0, 9)
    rings = []
    for share, up in ((1.0, 0.0), (0.62, 0.55), (0.18, 1.0)):
        radius = width_m / 2 * share * uneven * draws.uniform(0.92, 1.0, 9)
        ring = np.column_stack([radius * exact.cos(angle), radius * exact.sin(angle), np.full(9, height_m * up)])
        rings.append(ring)
    return (shape(_LOADS[variant % 3], mound(rings)),)


def trailer(variant: int) -> Piece:
    """Build a parked trailer with its drawbar ahead: a box, a load under canvas, or a caravan."""
    top = (1.3, 1.9, 2.5)[variant % 3]
    body = block((-1.6, 1.2), (-0.85, 0.85), (0.45, top), 0.97)
    bars = block((1.2, 2.3), (-0.05, 0.05), (0.45, 0.55)), block((1.9, 1.98), (-0.04, 0.04), (0.0, 0.5))
    wheels = [bar((-0.3, y - 0.1, 0.3), (-0.3, y + 0.1, 0.3), 0.3, sides=8) for y in (-0.95, 0.95)]
    return shape((GREY, BLUE, WHITE)[variant % 3], body), shape(DARK_METAL, *bars), shape(RUBBER, *wheels)
