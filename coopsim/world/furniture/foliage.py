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
from coopsim.world.furniture.materials import LEAVES
from coopsim.world.furniture.piece import Shape

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
    """Fill an ellipsoid with plates.

    Args:
        size_m: lengths of its axes; nearly all plates are inside.
        k_per_m: share of rays stopped per metre.
        count: number of plates, which decides their size.
        variant: arrangement of the plates.

    Returns:
        Corners (N, 3, 3) m around the ellipsoid's middle, and the axes (3,) m of the ellipsoid that the plates' middles
        fill: it is there that the law holds.
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
    """Fill an upright block, which goes on beyond its ends along x, with plates; as `ball_of_leaves`.

    The law holds for the whole thickness along y: what rays cross of a layer does not depend on how deep in it plates
    are. So only their heights decide on the volume.
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
    """Make a shape of plates (N, 3, 3) m around a middle (3,) m; none is lower than the ground.

    `opacity` is the share of rays through it that return.
    """
    vertices = corners.reshape(-1, 3) + middle_m
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.02)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    around = np.array([*middle_m, *np.ptp(vertices, axis=0) * 0.8, 0.0])
    around[5] = min(around[5], 2 * middle_m[2])
    return Shape(vertices, faces, LEAVES[variant % len(LEAVES)], False, around[None], opacity)


def mean_opacity(size_m: Floats, k_per_m: float) -> float:
    """Return the share of rays stopped over the mean chord of an ellipsoid with axes (3,) m, 2/3 of its mean axis."""
    return float(exact.settled(-np.expm1(-k_per_m * 2 / 3 * np.mean(size_m))))
