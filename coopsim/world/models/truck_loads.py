"""Bodies and loads of trucks: parts in the truck's frame, the rear end at x = 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.world.models.attachments import TARPAULIN, WOOD
from coopsim.world.models.parts import (
    ACCENT,
    LEFT,
    METAL,
    PLASTIC,
    REAR,
    RIGHT,
    Part,
    Surface,
    Window,
    block,
    level,
    loft,
    tube,
)

CONCRETE = Surface(0.0, 0.4, (150, 148, 142))


class Space(NamedTuple):
    """Where the load is: from the rear end to `end_m`, `half_m` to either side, from the floor up to the top."""

    end_m: float
    half_m: float
    floor_m: float
    top_m: float


def box(space: Space) -> list[Part]:
    """Build a closed box."""
    return [block((0.0, space.end_m), space.half_m, (space.floor_m, space.top_m), ACCENT)]


def container(space: Space) -> list[Part]:
    """Build a container of 6.1 m on twist locks, doors to the rear."""
    front, low = space.end_m - 0.1, space.floor_m + 0.08
    start = max(0.1, front - 6.06)
    doors = Window(METAL, 0.03, 0.48)
    levels = [level(z, (start, front), space.half_m) for z in (low, space.top_m)]
    return [loft(levels, ACCENT, {(0, REAR): doors}), *_deck(space)]


def curtains(space: Space) -> list[Part]:
    """Build sides of tarpaulin and a ridged roof."""
    levels = [
        level(space.floor_m, (0.0, space.end_m), space.half_m),
        level(0.93 * space.top_m, (0.0, space.end_m), space.half_m),
        level(space.top_m, (0.1, space.end_m - 0.1), 0.8 * space.half_m),
    ]
    sides = {(0, side): TARPAULIN for side in (LEFT, RIGHT)}
    return [loft(levels, ACCENT, sides)]


def pallets(space: Space) -> list[Part]:
    """Build pallets with goods, not all equally high, and dropsides."""
    width, rows = 0.9 * space.half_m, max(2, int(space.end_m / 1.5))
    parts, step = _dropsides(space), (space.end_m - 0.2) / rows
    for k, (share, surface) in enumerate(zip((1.0, 0.55, 0.8, 0.4), (WOOD, PLASTIC, TARPAULIN, CONCRETE), strict=True)):
        if k < rows:
            low, high = space.floor_m, space.floor_m + share * (space.top_m - space.floor_m)
            parts.append(block((0.1 + k * step, k * step + 0.9 * step), width, (low, high), surface))
    return parts


def pipes(space: Space) -> list[Part]:
    """Build two layers of pipes."""
    radius = 0.2
    low, middle = space.floor_m + 0.85 * radius, space.half_m - radius
    rows = [(y, low) for y in np.linspace(-middle, middle, 5)]
    rows += [(y, low + 1.6 * radius) for y in np.linspace(-middle, middle, 5)[:-1] + middle / 4]
    return [
        *(tube([[0.0, y, z], [space.end_m, y, z]], [radius, radius], CONCRETE, 5) for y, z in rows),
        *_deck(space),
    ]


def earth(space: Space) -> list[Part]:
    """Build dropsides with a heap of earth."""
    heap = [
        level(space.floor_m + 0.2, (0.1, space.end_m - 0.1), 0.94 * space.half_m),
        level(space.top_m, (0.35 * space.end_m, 0.7 * space.end_m), 0.3 * space.half_m),
    ]
    return [*_dropsides(space), loft(heap, Surface(0.0, 0.25, (104, 84, 62)))]


def tank(space: Space) -> list[Part]:
    """Build a tank with narrower ends."""
    radius = 0.5 * (space.top_m - space.floor_m)
    z = space.floor_m + radius
    x = [0.0, 0.25, space.end_m - 0.25, space.end_m]
    shell = tube([[at, 0.0, z] for at in x], [0.7 * radius, radius, radius, 0.7 * radius], ACCENT, 10)
    return [shell, *_deck(space)]


def drum(space: Space) -> list[Part]:
    """Build a concrete mixer's drum, which rises to the rear, and its chute."""
    middle, reach = 0.5 * (space.floor_m + space.top_m), 0.5 * (space.top_m - space.floor_m)
    path = [[0.5, 0.0, middle + 0.45 * reach], [0.5 * space.end_m, 0.0, middle], [space.end_m, 0.0, middle - 0.1]]
    drum = tube(path, [0.45 * reach, 0.95 * reach, 0.5 * reach], ACCENT, 8)
    chute = tube([[0.45, 0.0, middle + 0.3 * reach], [-0.0, 0.0, space.floor_m + 0.1]], [0.25, 0.2], METAL)
    stand = block((0.5, 0.9), 0.5, (space.floor_m, middle), METAL)
    return [drum, chute, stand, *_deck(space)]


def refuse(space: Space) -> list[Part]:
    """Build a refuse body with a sloping loader behind."""
    floor, top, half = space.floor_m, space.top_m, space.half_m
    loader = [level(floor - 0.3, (0.0, 1.5), 0.97 * half), level(0.55 * top, (0.0, 1.5), 0.97 * half)]
    loader.append(level(0.97 * top, (0.7, 1.5), 0.97 * half))
    return [
        block((1.5, space.end_m), half, (floor, top), ACCENT),
        loft(loader, ACCENT, {(1, REAR): PLASTIC, (0, REAR): Window(PLASTIC, 0.2, 0.1)}),
    ]


def _deck(space: Space) -> list[Part]:
    return [block((0.0, space.end_m), space.half_m, (space.floor_m - 0.12, space.floor_m), WOOD)]


def _dropsides(space: Space) -> list[Part]:
    """Build a deck with low walls as one tray: its floor is inside."""
    return [*_deck(space), block((0.0, space.end_m), space.half_m, (space.floor_m, space.floor_m + 0.35), ACCENT)]
