"""Trucks and buses: levels stacked from the floor to the roof, wheels below.

Directive 96/53/EC allows a length of 12 m (a bus with two axles 13.5 m), a width of 2.55 m without mirrors and a height
of 4 m. The city bus has the size of a Mercedes-Benz Citaro (11.95 x 2.55 x 3.08 m), the coach of a Setra S 515 HD; the
others have usual sizes. For comparison, nuScenes' anchors (means of labelled boxes) are 6.93 x 2.51 x 2.84 m for trucks
and 11.19 x 2.94 x 3.47 m for buses.
"""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.models.parts import (
    ACCENT,
    FRONT,
    GLASS,
    HEADLIGHT,
    LEFT,
    METAL,
    PAINT,
    PLASTIC,
    REAR,
    RIGHT,
    TAILLIGHT,
    Dress,
    Part,
    Window,
    assemble,
    block,
    level,
    loft,
    wheel,
)

Size = tuple[float, float, float]


def make_trucks() -> list[Model]:
    """Build three rigid trucks; the whole box turns with the cab."""
    return [_box_truck("box_truck", (7.5, 2.4, 3.1), 2), _box_truck("heavy_truck", (9.6, 2.5, 3.6), 3), _tipper()]


def make_buses() -> list[Model]:
    """Build a small bus, a city bus and a coach."""
    return [
        _bus("midibus", (8.9, 2.45, 2.95), (0.24, 0.76), belt=0.42),
        _bus("city_bus", (11.95, 2.55, 3.08), (0.27, 0.77), belt=0.38),
        _bus("coach", (12.30, 2.55, 3.77), (0.17, 0.27, 0.78), belt=0.52),
    ]


def _box_truck(name: str, size_m: Size, axles: int) -> Model:
    """Build a cab and a cargo box, which may have another colour."""
    length, width, height = size_m
    cab_m, floor = 1.95, 1.05
    cargo = block((0.0, length - cab_m - 0.25), width / 2, (floor, height), ACCENT)
    places = [0.16 * length, length - 1.2, 0.31 * length][:axles]
    return assemble(
        name,
        ObjectClass.TRUCK,
        [
            [
                cargo,
                *cab(length, width, cab_m, min(2.75, 0.85 * height)),
                *chassis(length, floor),
                *axle_wheels(places, width),
            ]
        ],
        size_m,
    )


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
    parts = [skip, shield, *cab(length, width, cab_m, 2.95), *chassis(length, floor)]
    return assemble(
        "tipper",
        ObjectClass.TRUCK,
        [[*parts, *axle_wheels([0.17 * length, 0.33 * length, length - 1.4], width)]],
        size_m,
    )


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


def _bus(name: str, size_m: Size, axles: Sequence[float], belt: float) -> Model:
    return assemble(name, ObjectClass.BUS, [bus_parts(size_m, axles, belt)], size_m)


def bus_parts(size_m: Size, axles: Sequence[float], belt: float) -> list[Part]:
    """Build a bus: skirt in the second colour, a band of windows from `belt` up, a windscreen.

    Args:
        size_m: length, width, height.
        axles: their places, as shares of the length.
        belt: lower edge of the windows, as a share of the height.
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
