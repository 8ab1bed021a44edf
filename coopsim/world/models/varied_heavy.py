"""Trucks with other bodies and loads, and more buses; all with number plates.

Sizes are usual ones, none longer or wider than the largest plain truck and bus, so that all turn and park where these
do: a dropside of 3.5 t like an Iveco Daily, box vans, vehicles of 7.5 to 26 t; a Mercedes-Benz Sprinter as a minibus,
an Alexander Dennis Enviro400 with two decks. Shares are such that sizes are spread as nuScenes' (see
docs/reference/actors.md), whose trucks include pickups and delivery vans.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.attachments import DIRTY_PLATE, RETRO_PLATE, plate
from coopsim.world.models.heavy import Size, axle_wheels, bus_parts, cab, chassis
from coopsim.world.models.model import Model
from coopsim.world.models.parts import (
    FRONT,
    GLASS,
    LEFT,
    PAINT,
    REAR,
    RIGHT,
    Part,
    Window,
    assemble,
    level,
    loft,
)
from coopsim.world.models.truck_loads import (
    Space,
    box,
    container,
    curtains,
    drum,
    earth,
    pallets,
    pipes,
    refuse,
    tank,
)


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
_BUSES: tuple[_Bus, ...] = (  # name, size, share, axles and height of the windows' lower edge as shares
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
        for name, size_m, share, axles, belt in _BUSES
    ]
    buses.append(("double_decker", (10.90, 2.52, 4.30), 1.1, _double_decker((10.90, 2.52, 4.30))))
    return [
        replace(assemble(name, ObjectClass.BUS, [parts], size_m), share=share) for name, size_m, share, parts in buses
    ]


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
    return replace(assemble(truck.name, ObjectClass.TRUCK, [parts], truck.size_m), share=truck.share)


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
