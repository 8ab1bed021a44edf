"""What stands along a line, in pieces of one length: fences, railings, barriers, scaffolds. A piece lies along x."""

from __future__ import annotations

import numpy as np

from coopsim.world.furniture.materials import CONCRETE, DARK_METAL, SIGN_RED, SIGN_WHITE, WHITE, WOOD, ZINC
from coopsim.world.furniture.piece import Piece, Shape, box_around, shape
from coopsim.world.furniture.solids import Solid, block, joined, post, prism, sheet

_SLATS_PER_M = 4
_SLAT_SHARE = 0.55
_POST_M = 2.0


def fence(length_m: float, height_m: float, variant: int) -> Piece:
    """Build posts and upright slats; between these one sees through 45 %."""
    count = max(2, round(_SLATS_PER_M * length_m))
    pitch, half = length_m / count, length_m / 2
    slats = [_upright(-half + (k + 0.5) * pitch, _SLAT_SHARE * pitch / 2, (0.08, height_m)) for k in range(count)]
    rails = [_upright(0.0, half, (z - 0.04, z + 0.04)) for z in (0.25, height_m - 0.2)]
    places = -half + 0.05 + np.arange(max(1, round(length_m / _POST_M))) * _POST_M
    posts = [sheet(x, (-0.05, 0.05), (0.0, height_m + 0.05)) for x in places.tolist()]
    mesh = joined([*slats, *rails, *posts])
    around = box_around(mesh.vertices)[None]
    return (Shape(mesh.vertices, mesh.faces, (WOOD, WHITE, WOOD)[variant % 3], False, around, _SLAT_SHARE),)


def railing(length_m: float, height_m: float, _: int) -> Piece:
    """Build a railing of steel at a pavement's edge: two bars between posts."""
    half = length_m / 2
    bars = [block((-half, half), (-0.025, 0.025), (z - 0.03, z + 0.03)) for z in (0.55 * height_m, height_m - 0.03)]
    places = -half + 0.03 + np.arange(max(1, round(length_m / _POST_M))) * _POST_M
    posts = [block((x - 0.03, x + 0.03), (-0.03, 0.03), (0.0, height_m)) for x in places.tolist()]
    return (shape(DARK_METAL, *posts, *bars),)


def crash_barrier(length_m: float, height_m: float, _: int) -> Piece:
    """Build a crash barrier: a beam on posts, which looks to the left."""
    half = length_m / 2
    count = max(1, round(length_m / 4.0))
    places = -half + (np.arange(count) + 0.5) * length_m / count
    feet = [block((x - 0.06, x + 0.06), (-0.1, 0.0), (0.0, height_m - 0.05)) for x in places.tolist()]
    return (shape(ZINC, block((-half, half), (0.0, 0.09), (height_m - 0.32, height_m)), *feet),)


def concrete_barrier(length_m: float, height_m: float, _: int) -> Piece:
    """Build a barrier of concrete that is broad at its foot."""
    outline = [(0.3, 0.0), (0.3, 0.08), (0.1, 0.35), (0.08, height_m)]
    ring = [*outline, *((-y, z) for y, z in reversed(outline))]
    ends = [np.array([[x, y, z] for y, z in ring]) for x in (-length_m / 2, length_m / 2)]
    return (shape(CONCRETE, prism(ends[0], ends[1])),)


def work_fence(length_m: float, height_m: float, _: int) -> Piece:
    """Build a fence of road works: red and white boards on feet."""
    half = length_m / 2
    boards = [block((x, x + half), (-0.02, 0.02), (height_m - 0.25, height_m)) for x in (-half, 0.0)]
    low = block((-half, half), (-0.02, 0.02), (0.3, 0.42))
    feet = [block((x - 0.05, x + 0.05), (-0.3, 0.3), (0.0, 0.12)) for x in (-half + 0.1, half - 0.1)]
    stays = [block((x - 0.02, x + 0.02), (-0.02, 0.02), (0.12, height_m - 0.25)) for x in (-half + 0.1, half - 0.1)]
    return shape(SIGN_RED, boards[0]), shape(SIGN_WHITE, boards[1], low), shape(DARK_METAL, *feet, *stays)


def scaffold(length_m: float, height_m: float, _: int) -> Piece:
    """Build a bay of a scaffold, a metre deep: standards, and boards and rails every two metres."""
    half, levels = length_m / 2, np.arange(2.0, max(height_m - 0.9, 2.1), 2.0).tolist()
    poles = [post(-half, y, (0.0, height_m), 0.04) for y in (-0.45, 0.45)]
    rails = [block((-half, half), (0.42, 0.47), (z + 0.95, z + 1.0)) for z in levels]
    boards = [block((-half, half), (-0.4, 0.4), (z - 0.05, z)) for z in levels]
    return shape(ZINC, *poles, *rails), shape(WOOD, *boards)


def _upright(x: float, half_m: float, z: tuple[float, float]) -> Solid:
    corners = [[x - half_m, 0.0, z[0]], [x + half_m, 0.0, z[0]], [x + half_m, 0.0, z[1]], [x - half_m, 0.0, z[1]]]
    return Solid(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))
