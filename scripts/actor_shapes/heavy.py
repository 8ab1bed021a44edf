"""Trucks and buses: levels stacked from the floor to the roof, wheels below.

Directive 96/53/EC allows a length of 12 m (a bus with two axles 13.5 m), a width of 2.55 m without mirrors and a height
of 4 m. The city bus has the size of a Mercedes-Benz Citaro (11.95 x 2.55 x 3.08 m), the coach of a Setra S 515 HD; the
others have usual sizes. For comparison, nuScenes' anchors (means of labelled boxes) are 6.93 x 2.51 x 2.84 m for trucks
and 11.19 x 2.94 x 3.47 m for buses.

Variants have number plates, and usual sizes: a dropside of 3.5 t like an Iveco Daily, box vans, vehicles of 7.5 to 26
t; a Mercedes-Benz Sprinter as a minibus, an Alexander Dennis Enviro400 with two decks. None is longer or wider than the
largest plain truck and bus, so that all turn and park where these do. Shares are such that sizes are spread as
nuScenes' (see docs/reference/actors.md), whose trucks include pickups and delivery vans.

Loads are in the truck's frame, the rear end at x = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from actor_shapes.attachments import DIRTY_PLATE, RETRO_PLATE, TARPAULIN, WOOD, plate
from actor_shapes.parts import (
    FRONT,
    LEFT,
    REAR,
    RIGHT,
    Dress,
    Part,
    Window,
    assemble,
    block,
    level,
    loft,
    tube,
    wheel,
)
from actor_shapes.surfaces import ACCENT, GLASS, HEADLIGHT, METAL, PAINT, PLASTIC, TAILLIGHT, Surface
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

Size = tuple[float, float, float]


def make_trucks() -> list[Model]:
    """Build three rigid trucks; the whole box turns with the cab."""
    return [_box_truck("box_truck", (7.5, 2.4, 3.1), 2), _box_truck("heavy_truck", (9.6, 2.5, 3.6), 3), _tipper()]


def make_buses() -> list[Model]:
    """Build a small bus, a city bus and a coach."""
    return [
        assemble(name, ObjectClass.BUS, [bus_parts(size_m, axles, belt)], size_m)
        for name, size_m, _, axles, belt in _BUSES[:3]
    ]


def _box_truck(name: str, size_m: Size, axles: int) -> Model:
    """Build a cab and a cargo box, which may have another colour."""
    length, width, height = size_m
    cab_m, floor = 1.95, 1.05
    cargo = block((0.0, length - cab_m - 0.25), width / 2, (floor, height), ACCENT)
    places = [0.16 * length, length - 1.2, 0.31 * length][:axles]
    parts = [cargo, *cab(length, width, cab_m, min(2.75, 0.85 * height)), *chassis(length, floor)]
    return assemble(name, ObjectClass.TRUCK, [[*parts, *axle_wheels(places, width)]], size_m)


def _tipper() -> Model:
    """Build a cab and a loaded open body with sloping walls."""
    length, width, height = size_m = (8.3, 2.5, 3.2)
    cab_m, floor = 2.0, 1.2
    end = length - cab_m - 0.2
    load = [
        level(floor, (0.25, end), 0.42 * width),
        level(0.80 * height, (0.0, end), width / 2),
        level(0.92 * height, (0.6, end - 0.6), 0.2 * width),
    ]
    skip = loft(load, ACCENT, ends=(ACCENT, PLASTIC), dress={(1, side): PLASTIC for side in range(4)})
    shield = block((end - 0.05, end + 0.05), 0.48 * width, (floor, height), ACCENT)
    wheels = axle_wheels([0.17 * length, 0.33 * length, length - 1.4], width)
    parts = [skip, shield, *cab(length, width, cab_m, 2.95), *chassis(length, floor), *wheels]
    return assemble("tipper", ObjectClass.TRUCK, [parts], size_m)


def cab(length: float, width: float, cab_m: float, height: float) -> list[Part]:
    """Build a cab over the front axle: bumper, lights, grille, windows to three sides."""
    half, rear = 0.48 * width, length - cab_m
    levels = [
        level(0.45, (rear, length), half),
        level(0.80, (rear, length), half),
        level(0.52 * height, (rear, length), half),
        level(0.90 * height, (rear, length - 0.14), half, 0.95 * half),
        level(height, (rear + 0.1, length - 0.35), 0.9 * half),
    ]
    door = Window(GLASS, 0.1, 0.2)
    windows = {
        (2, FRONT): Window(GLASS, 0.08, 0.05),
        (2, LEFT): door,
        (2, RIGHT): door,
        (1, FRONT): Window(PLASTIC, 0.15, 0.18),
    }
    lamps = [
        block((length - 0.1, length + 0.01), 0.16, (0.55, 0.72), HEADLIGHT, side * 0.72 * half) for side in (1, -1)
    ]
    return [loft(levels, PAINT, {**windows, (0, FRONT): PLASTIC}), *lamps]


def chassis(length: float, floor: float) -> list[Part]:
    """Build the frame below the floor, with rear lights."""
    frame = block((0.05, length - 0.5), 0.45, (0.6, floor), METAL)
    lights = block((0.0, 0.08), 1.0, (0.62, 0.78), TAILLIGHT)
    return [frame, lights]


def bus_parts(size_m: Size, axles: Sequence[float], belt: float) -> list[Part]:
    """Build a bus: skirt in the second colour, a band of windows from `belt` up, a windscreen.

    `axles` are places as shares of the length, and `belt` is a share of the height.
    """
    length, width, height = size_m
    half = width / 2
    levels = [
        level(0.30, (0.05, length - 0.05), 0.98 * half),
        level(0.85, (0.0, length), half),
        level(belt * height, (0.0, length), half),
        level(0.86 * height, (0.02, length - 0.12), 0.985 * half, 0.95 * half),
        level(height, (0.25, length - 0.45), 0.88 * half),
    ]
    side, back = Window(GLASS, 0.04, 0.03), Window(GLASS, 0.15, 0.15)
    dress: Dress = {
        **{(0, each): ACCENT for each in range(4)},
        (2, LEFT): side,
        (2, RIGHT): side,
        (2, REAR): back,
        (2, FRONT): Window(GLASS, 0.02, 0.04),
        (1, FRONT): Window(PAINT, 0.3, 0.3),
    }
    lamps = [
        block(x, 0.18, (0.62, 0.80), lamp, place * 0.78 * half)
        for x, lamp in (((length - 0.06, length + 0.01), HEADLIGHT), ((-0.01, 0.06), TAILLIGHT))
        for place in (1, -1)
    ]
    places = [share * length for share in axles]
    return [loft(levels, PAINT, dress), *lamps, *axle_wheels(places, width)]


def axle_wheels(places_m: Sequence[float], width: float, radius: float = 0.5) -> list[Part]:
    """Build two wheels on each axle."""
    return [wheel(x, side * (width / 2 + 0.005), radius, 0.32) for x in places_m for side in (1, -1)]


CONCRETE = Surface(0.0, 0.4, (150, 148, 142))


class Space(NamedTuple):
    """Room for a load: from the rear end to `end_m`, `half_m` to either side, from the floor up to the top."""

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


class _Truck(NamedTuple):
    """A truck: name, size, how often it is chosen, length and height of the cab, axles, what it carries."""

    name: str
    size_m: Size
    share: float
    cab_m: tuple[float, float]
    axles: int
    load: Callable[[Space], list[Part]]
    soiled: bool = False


# fmt: off
_TRUCKS = (
    _Truck("small_dropside", (5.40, 2.00, 2.15), 3.0, (1.75, 2.12), 2, pallets),
    _Truck("small_dropside_earth", (5.60, 2.05, 2.20), 1.2, (1.75, 2.16), 2, earth, soiled=True),
    _Truck("small_box_truck", (5.80, 2.12, 2.75), 1.2, (1.70, 2.20), 2, box),
    _Truck("luton_truck", (6.30, 2.24, 3.05), 0.7, (1.70, 2.30), 2, box, soiled=True),
    _Truck("flatbed_pallets", (6.90, 2.40, 2.70), 0.7, (1.85, 2.55), 2, pallets, soiled=True),
    _Truck("flatbed_pipes", (7.20, 2.45, 2.65), 0.5, (1.85, 2.60), 2, pipes),
    _Truck("curtain_truck", (8.20, 2.50, 3.55), 0.7, (1.95, 2.80), 2, curtains),
    _Truck("container_truck", (9.40, 2.50, 3.80), 2.0, (2.00, 2.95), 3, container, soiled=True),
    _Truck("tanker", (8.60, 2.50, 3.20), 0.4, (2.00, 2.90), 3, tank),
    _Truck("concrete_mixer", (8.50, 2.50, 3.65), 0.5, (2.00, 2.90), 3, drum, soiled=True),
    _Truck("refuse_truck", (8.90, 2.50, 3.40), 0.5, (2.00, 2.85), 3, refuse, soiled=True),
)

_Bus = tuple[str, Size, float, tuple[float, ...], float]
_BUSES: tuple[_Bus, ...] = (
    # name, size, share, axles and height of the windows' lower edge as shares; the first three are plain
    ("midibus", (8.9, 2.45, 2.95), 1.0, (0.24, 0.76), 0.42),
    ("city_bus", (11.95, 2.55, 3.08), 1.0, (0.27, 0.77), 0.38),
    ("coach", (12.30, 2.55, 3.77), 1.0, (0.17, 0.27, 0.78), 0.52),
    ("minibus", (7.40, 2.20, 2.85), 1.2, (0.22, 0.80), 0.44),
    ("short_bus", (10.50, 2.50, 3.10), 0.6, (0.26, 0.76), 0.38),
    ("long_city_bus", (12.20, 2.55, 3.35), 1.2, (0.27, 0.77), 0.36),
    ("high_coach", (12.25, 2.55, 3.70), 1.8, (0.17, 0.27, 0.78), 0.52),
)
# fmt: on


def make_varied_trucks() -> list[Model]:
    """Build trucks of more kinds."""
    return [_truck(truck) for truck in _TRUCKS]


def make_varied_buses() -> list[Model]:
    """Build buses of more sizes, one of them with two decks."""
    buses = [
        (name, size_m, share, [*bus_parts(size_m, axles, belt), *_bus_plates(size_m[0])])
        for name, size_m, share, axles, belt in _BUSES[3:]
    ]
    buses.append(("double_decker", (10.90, 2.52, 4.30), 1.1, _double_decker((10.90, 2.52, 4.30))))
    return [assemble(name, ObjectClass.BUS, [parts], size_m, share=share) for name, size_m, share, parts in buses]


def _truck(truck: _Truck) -> Model:
    length, width, height = truck.size_m
    small = length < 6.5
    floor, (cab_m, cab_height) = (0.85 if small else 1.1), truck.cab_m
    space = Space(length - cab_m - 0.2, width / 2, floor, height)
    places = [0.18 * length, length - 0.62 * cab_m, 0.33 * length][: truck.axles]
    surface = DIRTY_PLATE if truck.soiled else RETRO_PLATE
    parts = [
        *truck.load(space),
        *cab(length, width, cab_m, cab_height),
        *chassis(length, floor - 0.05),
        *axle_wheels(places, width, 0.38 if small else 0.5),
        plate(-0.02, 0.62, -1.0, surface),
        plate(length + 0.02, 0.56, 1.0, surface),
    ]
    return assemble(truck.name, ObjectClass.TRUCK, [parts], truck.size_m, share=truck.share)


def _double_decker(size_m: Size) -> list[Part]:
    """Build a bus of two decks, each with its band of windows."""
    length, width, height = size_m
    lower = bus_parts((length, width, 0.54 * height), (0.22, 0.78), 0.52)
    half = width / 2
    levels = [
        level(0.5 * height, (0.05, length - 0.12), 0.985 * half),
        level(0.66 * height, (0.0, length - 0.12), half),
        level(0.92 * height, (0.05, length - 0.25), 0.97 * half),
        level(height, (0.3, length - 0.5), 0.88 * half),
    ]
    side = Window(GLASS, 0.04, 0.03)
    dress = {
        (1, LEFT): side,
        (1, RIGHT): side,
        (1, REAR): Window(GLASS, 0.1, 0.15),
        (1, FRONT): Window(GLASS, 0.04, 0.04),
    }
    return [*lower, loft(levels, PAINT, dress), *_bus_plates(length)]


def _bus_plates(length: float) -> list[Part]:
    return [plate(-0.015, 0.55, -1.0), plate(length + 0.015, 0.45, 1.0)]
