"""Foliage: flat clumps of leaves at random places in a volume, so that some rays return and others pass.

Many small opaque plates whose middles are independent and uniform in a volume, and whose directions are uniform on the
sphere, let a ray pass over a path of d metres with the probability exp(-k d): the law of Beer and Lambert, which Monsi
and Saeki (1953) found to hold in stands of plants. k is the plates' area seen along the ray in each cubic metre: their
one-sided area there times 1/2, the mean shadow of a flat plate of random direction (Cauchy). So k = N A / (2 V) for N
plates of area A in a volume V, whatever their size; as it is geometry, rays of LiDARs and of cameras and lines of sight
agree on what returns and what passes.

Values: Vose et al. (1995) found 0.53 to 0.67 of light stopped per unit of leaf area index in stands of hardwood;
crowns of single town trees in leaf let 1 to 5 % of direct sunlight through (Konarska et al. 2014). At 0.6 per metre, a
crown of 5 m lets 5 % through its middle. Hedges and bushes are denser: 15 % through a hedge of 0.8 m, ours.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.furniture.solids import Material, Piece, Shape, bar, shape

BARK = Material((92, 70, 52), 0.3)
LEAVES = (Material((70, 104, 58), 0.45), Material((86, 116, 62), 0.45), Material((58, 92, 60), 0.45))

CROWN_K_PER_M, BUSH_K_PER_M, HEDGE_K_PER_M = 0.6, 2.4, 2.4
"""Share of rays that is stopped per metre, at short paths."""

VARIANTS = 4
"""Different arrangements of plates; pieces of furniture take them in turn."""

_PLATE_RADIUS = 2 / math.sqrt(3.0 * math.sqrt(3.0))  # circumradius of a regular triangle of area 1
_HEIGHT = math.sqrt(0.75)
_KEPT_IN = 0.7  # of a plate's radius: how far middles stay from the outline


@lru_cache(64)
def _plates(variant: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Return middles in the unit cube and in the unit ball (N, 3), and triangles of area 1 around the origin (N, 3, 3).

    The cube is [-1/2, 1/2] on all axes, the ball's diameter is 1.
    """
    draws = stream(variant, "foliage", str(count))
    in_cube = draws.uniform(-0.5, 0.5, (count, 3))
    direction = exact.settled(draws.normal(size=(count, 3)))
    direction /= exact.norm(direction, axis=1, keepdims=True)
    in_ball = 0.5 * direction * exact.settled(np.cbrt(draws.uniform(size=(count, 1))))
    normal, other = exact.settled(draws.normal(size=(2, count, 3)))
    first = np.cross(normal, other)
    second = np.cross(normal, first)
    first, second = (axis / exact.norm(axis, axis=1, keepdims=True) for axis in (first, second))
    cos, sin = np.array([1.0, -0.5, -0.5]), np.array([0.0, _HEIGHT, -_HEIGHT])
    spokes = cos[:, None] * first[:, None] + sin[:, None] * second[:, None]
    return in_cube, in_ball, _PLATE_RADIUS * spokes


def ball_of_leaves(
    size_m: tuple[float, float, float], k_per_m: float, count: int, variant: int
) -> tuple[Floats, Floats]:
    """Fill an ellipsoid with plates; nearly all are inside, and their number decides their size.

    Returns:
        Corners (N, 3, 3) m around the ellipsoid's middle, and the axes (3,) m of the ellipsoid that the plates' middles
        fill, in which the law holds.
    """
    _, middles, plates = _plates(variant % VARIANTS, count)
    outer, radius = np.array(size_m), 0.0
    for _ in range(6):  # the plates' size depends on the volume that is left to their middles
        body = np.maximum(outer - 2 * _KEPT_IN * radius, 0.3 * outer)
        scale = np.sqrt(2 * k_per_m * np.pi / 6 * body.prod() / count)
        radius = scale * _PLATE_RADIUS
    return middles[:, None] * body + scale * plates, body


def block_of_leaves(
    size_m: tuple[float, float, float], k_per_m: float, count: int, variant: int
) -> tuple[Floats, Floats]:
    """Fill an upright block, which goes on beyond its ends along x, with plates, like `ball_of_leaves`.

    The law holds for the whole thickness along y, wherever in it plates are: only their heights decide on the volume.
    """
    middles, _, plates = _plates(variant % VARIANTS, count)
    outer, radius = np.array(size_m), 0.0
    for _ in range(6):
        inner = outer - 2 * _KEPT_IN * radius * np.array([0.0, 1.0, 1.0])
        inner = np.maximum(inner, 0.2 * outer)
        scale = np.sqrt(2 * k_per_m * outer[0] * outer[1] * inner[2] / count)
        radius = scale * _PLATE_RADIUS
    return middles[:, None] * inner + scale * plates, np.array([outer[0], outer[1], inner[2]])


def leaves(corners: Floats, middle_m: tuple[float, float, float], opacity: float, variant: int) -> Shape:
    """Make a shape from plates (N, 3, 3) m around a middle (3,) m, none below the ground."""
    vertices = corners.reshape(-1, 3) + middle_m
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.02)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    around = np.array([*middle_m, *np.ptp(vertices, axis=0) * 0.8, 0.0])
    around[5] = min(around[5], 2 * middle_m[2])
    return Shape(vertices, faces, LEAVES[variant % len(LEAVES)], False, around[None], opacity)


def mean_opacity(size_m: Floats, k_per_m: float) -> float:
    """Return the share of rays stopped over the mean chord of an ellipsoid with axes (3,) m, 2/3 of its mean axis."""
    return float(exact.settled(-np.expm1(-k_per_m * 2 / 3 * np.mean(size_m))))


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
    opacity = float(exact.settled(-np.expm1(-HEDGE_K_PER_M * thickness_m)))
    return (leaves(plates, (0.0, 0.0, height_m / 2), opacity, variant),)
