"""Boxes and barrels in streets: bins, mail boxes, cabinets, recycling containers, planters, advertising columns."""

from __future__ import annotations

from coopsim.world.furniture.foliage import BUSH_K_PER_M, ball_of_leaves, leaves, mean_opacity
from coopsim.world.furniture.materials import (
    BLUE,
    CONCRETE,
    DARK_METAL,
    EARTH,
    GREEN,
    GREY,
    POSTER,
    RED,
    RUBBLE,
    YELLOW,
)
from coopsim.world.furniture.piece import Piece, shape
from coopsim.world.furniture.solids import block, drum

_PAINTS = (GREEN, BLUE, GREY, YELLOW)


def bin_of_litter(variant: int) -> Piece:
    """Build a litter bin with a hood."""
    hood = drum(0.0, 0.0, (0.92, 1.05), 0.27, 0.12)
    return (shape((GREEN, DARK_METAL, GREY)[variant % 3], drum(0.0, 0.0, (0.0, 0.9), 0.22, 0.26), hood),)


def dustbins(variant: int) -> Piece:
    """Build two dustbins of a house, their lids ahead."""
    bodies = [block((-0.33, 0.3), (y - 0.27, y + 0.27), (0.04, 1.0), 1.12) for y in (-0.33, 0.33)]
    lids = [block((-0.38, 0.38), (y - 0.29, y + 0.29), (1.0, 1.07)) for y in (-0.33, 0.33)]
    return shape(DARK_METAL, *bodies), shape(_PAINTS[variant % 4], *lids)


def mailbox(variant: int) -> Piece:
    """Build a mail box on a foot."""
    foot = block((-0.06, 0.06), (-0.1, 0.1), (0.0, 0.8))
    return (shape((YELLOW, RED, BLUE)[variant % 3], block((-0.22, 0.22), (-0.28, 0.28), (0.8, 1.45)), foot),)


def cabinet(variant: int) -> Piece:
    """Build a cabinet of electricity or telephone on its base."""
    half = (0.35, 0.6, 0.85)[variant % 3]
    base = block((-0.2, 0.2), (-half, half), (0.0, 0.15))
    return (shape(GREY, block((-0.17, 0.17), (-half + 0.03, half - 0.03), (0.15, 1.2)), base),)


def recycling(variant: int) -> Piece:
    """Build three containers for glass and paper."""
    return tuple(
        shape(_PAINTS[(variant + k) % 4], block((-0.65, 0.65), (y - 0.65, y + 0.65), (0.0, 1.5), 0.75))
        for k, y in enumerate((-1.45, 0.0, 1.45))
    )


def planter(variant: int) -> Piece:
    """Build a tub with a bush in it."""
    tub, earth = block((-0.4, 0.4), (-0.6, 0.6), (0.0, 0.5), 1.1), block((-0.38, 0.38), (-0.58, 0.58), (0.5, 0.52))
    plates, body = ball_of_leaves((0.9, 1.3, 0.75), BUSH_K_PER_M, 20, variant)
    bush = leaves(plates, (0.0, 0.0, 0.85), mean_opacity(body, BUSH_K_PER_M), variant)
    return shape(CONCRETE, tub), shape(EARTH, earth), bush


def advertising_column(_: int) -> Piece:
    """Build a round column for posters, under a hood."""
    base, hood = drum(0.0, 0.0, (0.0, 0.3), 0.66), drum(0.0, 0.0, (2.9, 3.3), 0.72, 0.3)
    return shape(POSTER, drum(0.0, 0.0, (0.3, 2.9), 0.6)), shape(GREEN, base, hood)


def skip(_: int) -> Piece:
    """Build a container of builders, full of rubble."""
    body, load = block((-0.9, 0.9), (-1.4, 1.4), (0.0, 1.25), 1.12), block((-0.85, 0.85), (-1.4, 1.4), (1.25, 1.5), 0.6)
    return shape(YELLOW, body), shape(RUBBLE, load)
