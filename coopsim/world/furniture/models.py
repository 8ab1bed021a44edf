"""Models of street furniture at a point, and along a line: a piece of these lies along x."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.furniture.foliage import BUSH_K_PER_M, ball_of_leaves, leaves, mean_opacity
from coopsim.world.furniture.solids import (
    Material,
    Piece,
    Shape,
    Solid,
    bar,
    block,
    box_around,
    drum,
    joined,
    mound,
    post,
    prism,
    shape,
    sheet,
)

ZINC = Material((148, 152, 156), 0.5)
DARK_METAL = Material((62, 68, 70), 0.3)
WOOD = Material((142, 104, 68), 0.5)
CONCRETE = Material((168, 166, 160), 0.4)
RUBBER = Material((30, 30, 32), 0.12)
GLASS = Material((150, 176, 182), 0.08)
GREEN = Material((58, 92, 66), 0.35)
GREY = Material((150, 152, 148), 0.4)
YELLOW = Material((214, 178, 52), 0.5)
RED = Material((178, 44, 40), 0.5)
BLUE = Material((52, 82, 140), 0.4)
WHITE = Material((226, 226, 220), 0.6)
CANVAS = Material((222, 214, 196), 0.6)
AWNING = Material((170, 66, 58), 0.55)
POSTER = Material((196, 170, 120), 0.5)
BRICK = Material((150, 92, 74), 0.4)
SAND = Material((198, 176, 130), 0.4)
RUBBLE = Material((134, 126, 118), 0.3)
EARTH = Material((96, 78, 60), 0.25)
SIGN_RED = Material((190, 40, 40), 140.0)
SIGN_BLUE = Material((40, 80, 160), 60.0)
SIGN_WHITE = Material((232, 232, 226), 780.0)
"""Reflectivities of matt surfaces are round numbers of the order of measured ones. Plates of signs send light back to
where it comes from: sheeting of class RA2 of EN 12899-1 has, new, at least 250 cd/(lx m2) in white, 45 in red and 20 in
blue, which is as many times the 1/pi of matt white."""

_X = np.array([1.0, 0.0, 0.0])
_SHEETS = (SIGN_RED, SIGN_BLUE, SIGN_WHITE, SIGN_RED)
_UNDER_PLATE_M = 2.2
"""Lower edge of a sign's plate over a pavement: 2.0 to 2.5 m are usual."""


def lamp(height_m: float, variant: int) -> Piece:
    """Build a lamp: a post, an arm ahead, and the head at its end."""
    arm = block((0.0, 1.5), (-0.04, 0.04), (height_m - 0.12, height_m))
    head = block((1.0, 1.8), (-0.15, 0.15), (height_m - 0.16, height_m - 0.02))
    return (shape(ZINC if variant % 2 else DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.1, 0.06), arm, head),)


def pole(height_m: float, variant: int) -> Piece:
    """Build a wooden pole for wires: a crossarm across, and on every third one a box below it."""
    arm = block((-0.06, 0.06), (-0.8, 0.8), (height_m - 0.6, height_m - 0.48))
    box = [] if variant % 3 else [block((0.1, 0.5), (-0.25, 0.25), (0.55 * height_m, 0.55 * height_m + 0.8))]
    return (shape(WOOD, post(0.0, 0.0, (0.0, height_m), 0.14, 0.1), arm, *box),)


def sign(height_m: float, variant: int) -> Piece:
    """Build a sign that looks ahead, round, square or triangular, on a post; its back is grey."""
    low_m = min(_UNDER_PLATE_M, height_m - 0.4)
    outline = _outline((8, 4, 4, 3)[variant % 4], low_m, height_m)
    board = prism(outline + _X * 0.03, outline + _X * 0.045)
    pole = block((-0.03, 0.03), (-0.03, 0.03), (0.0, height_m - 0.1))
    fan = np.arange(1, len(outline) - 1)
    front = Solid(outline + _X * 0.05, np.column_stack([np.zeros_like(fan), fan, fan + 1]))
    sheeting = Shape(front.vertices, front.faces, _SHEETS[variant % len(_SHEETS)], False, np.zeros((0, 7)))
    return shape(ZINC, pole, board), sheeting


def _outline(sides: int, low_m: float, high_m: float) -> Floats:
    """Return a regular outline (K, 3) m across x, between two heights, counter-clockwise from ahead."""
    turn = np.arange(sides) * 2 * np.pi / sides + (np.pi / 2 if sides == 3 else np.pi / sides)
    ring = np.stack([np.zeros(sides), exact.cos(turn), exact.sin(turn)], axis=1)
    scale = (high_m - low_m) / float(np.ptp(ring[:, 2]))
    ring *= scale
    ring[:, 2] += low_m - ring[:, 2].min()
    return ring


def traffic_light(height_m: float, _: int) -> Piece:
    """Build a traffic light that looks ahead."""
    head = block((0.05, 0.3), (-0.15, 0.15), (height_m - 0.95, height_m))
    return (shape(DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.055), head),)


def bollard(height_m: float, _: int) -> Piece:
    """Build a bollard with a ring that reflects."""
    ring = drum(0.0, 0.0, (height_m - 0.2, height_m - 0.1), 0.085)
    return shape(DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.075)), shape(SIGN_WHITE, ring)


def marker(height_m: float, _: int) -> Piece:
    """Build a marker post of a verge, with a plate that reflects ahead and back."""
    plate = block((-0.07, 0.07), (-0.03, 0.03), (height_m - 0.3, height_m - 0.12))
    return shape(WHITE, block((-0.06, 0.06), (-0.06, 0.06), (0.0, height_m))), shape(SIGN_WHITE, plate)


def hydrant(height_m: float, variant: int) -> Piece:
    """Build a hydrant with its outlets."""
    body = drum(0.0, 0.0, (0.0, 0.75 * height_m), 0.13)
    hood = drum(0.0, 0.0, (0.75 * height_m, height_m), 0.16, 0.07)
    outlets = block((-0.06, 0.06), (-0.22, 0.22), (0.5 * height_m, 0.65 * height_m))
    return (shape(RED if variant % 3 else YELLOW, body, hood, outlets),)


_CLOTHS = (CANVAS, AWNING, GREEN, BLUE)


def bench(_: int) -> Piece:
    """Build a bench for people who look ahead."""
    wood = block((-0.2, 0.3), (-0.9, 0.9), (0.4, 0.46)), block((-0.27, -0.22), (-0.9, 0.9), (0.55, 0.85))
    feet = [block((-0.27, 0.28), (y - 0.04, y + 0.04), (0.0, 0.4)) for y in (-0.7, 0.7)]
    stays = [block((-0.3, -0.27), (y - 0.03, y + 0.03), (0.0, 0.8)) for y in (-0.7, 0.7)]
    return shape(WOOD, *wood), shape(DARK_METAL, *feet, *stays)


def cafe_table(variant: int) -> Piece:
    """Build a round table with two chairs, and over every other one a parasol."""
    table = drum(0.0, 0.0, (0.7, 0.74), 0.38), block((-0.05, 0.05), (-0.05, 0.05), (0.0, 0.7))
    chairs = [solid for side in (-1, 1) for solid in _chair(side)]
    furniture = shape(WOOD if variant % 3 else DARK_METAL, *table, *chairs)
    return (furniture, *parasol(variant)) if variant % 2 else (furniture,)


def _chair(side: int) -> tuple[Solid, ...]:
    near, far = sorted((side * 0.5, side * 0.92))
    back = sorted((side * 0.9, side * 0.94))
    legs = [(near + 0.02, near + 0.06), (far - 0.06, far - 0.02)]
    return (
        block((near, far), (-0.21, 0.21), (0.43, 0.46)),
        block((back[0], back[1]), (-0.21, 0.21), (0.46, 0.86)),
        *(block(x, (-0.2, 0.2), (0.0, 0.43)) for x in legs),
    )


def parasol(variant: int) -> Piece:
    """Build an open parasol."""
    roof = bar((0.0, 0.0, 2.25), (0.0, 0.0, 2.7), 1.35, 0.05, sides=8)
    return (
        shape(_CLOTHS[variant // 2 % len(_CLOTHS)], roof),
        shape(ZINC, post(0.0, 0.0, (0.1, 2.3), 0.03), block((-0.25, 0.25), (-0.25, 0.25), (0.0, 0.1))),
    )


def shelter(_: int) -> Piece:
    """Build a bus shelter that is open ahead: panes of glass, a bench, a poster at its left end."""
    roof = block((-0.75, 0.75), (-1.9, 1.9), (2.4, 2.5))
    posts = [block((x - 0.04, x + 0.04), (y - 0.04, y + 0.04), (0.0, 2.4)) for x in (-0.66, 0.3) for y in (-1.8, 1.8)]
    seat = block((-0.5, -0.1), (-1.2, 1.0), (0.44, 0.5)), block((-0.35, -0.25), (-0.9, 0.7), (0.0, 0.44))
    panes = [block((-0.67, -0.65), (y - 0.85, y + 0.85), (0.25, 2.25)) for y in (-0.9, 0.9)]
    side = block((-0.62, 0.26), (-1.81, -1.79), (0.25, 2.25))
    poster = block((-0.62, 0.26), (1.76, 1.84), (0.3, 2.2))
    return shape(DARK_METAL, roof, *posts), shape(WOOD, *seat), shape(GLASS, *panes, side), shape(POSTER, poster)


def market_stall(variant: int) -> Piece:
    """Build a stall: a counter with goods under an awning."""
    posts = [block((x - 0.03, x + 0.03), (y - 0.03, y + 0.03), (0.0, 2.2)) for x in (-0.9, 0.9) for y in (-1.4, 1.4)]
    gable = [[0.0, -1.6, 2.75], [1.1, -1.6, 2.2], [-1.1, -1.6, 2.2]]
    roof = prism(gable, [[x, 1.6, z] for x, _, z in gable])
    counter = block((0.0, 0.8), (-1.3, 1.3), (0.1, 0.85))
    goods = [block((0.05, 0.75), (y - 0.28, y + 0.28), (0.85, 1.0 + 0.1 * k)) for k, y in enumerate((-0.8, 0.0, 0.8))]
    return shape(ZINC, *posts), shape(_CLOTHS[variant % 4], roof), shape(WOOD, counter, *goods)


def bicycle_rack(_: int) -> Piece:
    """Build four hoops, across the way ahead."""
    hoops = []
    for y in (-1.2, -0.4, 0.4, 1.2):
        hoops += [block((x - 0.025, x + 0.025), (y - 0.025, y + 0.025), (0.0, 0.78)) for x in (-0.35, 0.35)]
        hoops.append(block((-0.375, 0.375), (y - 0.025, y + 0.025), (0.78, 0.83)))
    return (shape(ZINC, *hoops),)


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
    high_m = height_m + 0.05
    posts = [sheet([[x, -0.05, 0.0], [x, 0.05, 0.0], [x, 0.05, high_m], [x, -0.05, high_m]]) for x in places.tolist()]
    mesh = joined([*slats, *rails, *posts])
    around = box_around(mesh.vertices)[None]
    return (Shape(mesh.vertices, mesh.faces, (WOOD, WHITE, WOOD)[variant % 3], False, around, _SLAT_SHARE),)


def garden_wall(length_m: float, height_m: float, variant: int) -> Piece:
    """Build a wall of a garden under a coping."""
    half = length_m / 2
    body = block((-half, half), (-0.11, 0.11), (0.0, height_m - 0.08))
    coping = block((-half, half), (-0.15, 0.15), (height_m - 0.08, height_m))
    return (shape((BRICK, CONCRETE, WHITE)[variant % 3], body, coping),)


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
    low, high = x - half_m, x + half_m
    return sheet([[low, 0.0, z[0]], [high, 0.0, z[0]], [high, 0.0, z[1]], [low, 0.0, z[1]]])
