"""Where people sit or wait: benches, tables of a café, parasols, bus shelters, stalls of a market, bicycle racks."""

from __future__ import annotations

from coopsim.world.furniture.materials import AWNING, BLUE, CANVAS, DARK_METAL, GLASS, GREEN, POSTER, WOOD, ZINC
from coopsim.world.furniture.piece import Piece, shape
from coopsim.world.furniture.solids import Solid, bar, block, drum, post, prism

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
