"""Plants: trees, bushes, hedges."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from coopsim.geometry import exact
from coopsim.world.furniture.foliage import (
    BUSH_K_PER_M,
    CROWN_K_PER_M,
    HEDGE_K_PER_M,
    ball_of_leaves,
    block_of_leaves,
    leaves,
    mean_opacity,
)
from coopsim.world.furniture.materials import BARK
from coopsim.world.furniture.piece import Piece, Shape, shape
from coopsim.world.furniture.solids import bar

CROWN_PLATES, BUSH_PLATES, HEDGE_PLATES_PER_M = 64, 18, 14
"""Numbers of plates: with fewer, these are larger, and as much light passes."""


def tree(height_m: float, crown_m: float, stem_m: float, variant: int) -> Piece:
    """Build a tree: a stem up to `stem_m`, where a crown `crown_m` wide begins, and two branches in it."""
    middle = (height_m + stem_m) / 2
    plates, body = ball_of_leaves((crown_m, crown_m, height_m - stem_m), CROWN_K_PER_M, CROWN_PLATES, variant)
    crown = leaves(plates, (0.0, 0.0, middle), mean_opacity(body, CROWN_K_PER_M), variant)
    return _wood(height_m, crown_m, stem_m), crown


@lru_cache(1024)
def _wood(height_m: float, crown_m: float, stem_m: float) -> Shape:
    """Build the stem and the branches of a tree, the same in all variants."""
    middle = (height_m + stem_m) / 2
    radius = 0.012 * height_m + 0.04
    fork = stem_m + 0.15 * (height_m - stem_m)
    spread = 0.25 * crown_m
    branches = [
        bar((0.0, 0.0, 0.9 * fork), (spread * exact.cos(a), spread * exact.sin(a), middle), 0.5 * radius, 0.03, sides=3)
        for a in (0.4, 3.3)
    ]
    return shape(BARK, bar((0.0, 0.0, 0.0), (0.0, 0.0, middle), radius, 0.3 * radius, sides=5), *branches)


def bush(height_m: float, width_m: float, variant: int) -> Piece:
    """Build a bush, leaves down to the ground."""
    plates, body = ball_of_leaves((width_m, width_m, height_m), BUSH_K_PER_M, BUSH_PLATES, variant)
    middle = (0.0, 0.0, 0.42 * height_m)  # its lowest leaves lie on the ground
    return (leaves(plates, middle, mean_opacity(body, BUSH_K_PER_M), variant),)


def hedge(length_m: float, height_m: float, thickness_m: float, variant: int) -> Piece:
    """Build a piece of a hedge along x; its leaves reach into the next piece."""
    count = max(8, round(HEDGE_PLATES_PER_M * length_m))
    plates, _ = block_of_leaves((length_m, thickness_m, height_m), HEDGE_K_PER_M, count, variant)
    return (
        leaves(
            plates, (0.0, 0.0, height_m / 2), float(exact.settled(-np.expm1(-HEDGE_K_PER_M * thickness_m))), variant
        ),
    )
