"""Cars and vans: one body from bumper to bumper on four wheels, from a table of cross-sections.

Sizes (length, width without mirrors, height) follow well-known vehicles of each kind: Toyota Corolla saloon, VW Golf,
Volvo V60, Toyota RAV4, Fiat 500, Ford Ranger; Renault Kangoo, VW Transporter, Ford Transit, Chrysler Pacifica. For
comparison, detectors' anchors (means of labelled boxes) are 4.61 x 1.95 x 1.72 m for nuScenes' cars and 5.03 x 1.87 x
2.21 m for KITTI's vans.

Variants have number plates; some are soiled, loaded or open. Their sizes are those of Smart fortwo, VW Polo,
Honda HR-V, Porsche 911, Honda Civic, VW Touran, Jeep Wrangler, Toyota Camry, Mercedes E and S, BMW X5, Ford Explorer
and F-150, Chevrolet Tahoe; Toyota Hiace and Sienna, Ford Transit. Shares are such that sizes are spread as nuScenes'
(see docs/reference/actors.md). None is longer or wider than the largest plain van, so that all have room where they
park.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from actor_shapes.attachments import (
    DIRTY_PLATE,
    INSIDE,
    RETRO_PLATE,
    bed_cover,
    boxes_on_bed,
    canopy,
    ladder,
    open_bonnet,
    open_boot,
    open_door,
    open_rear_doors,
    open_tailgate,
    pipes,
    plates,
    rear_bicycle,
    roof_box,
)
from actor_shapes.parts import Dress, Part, across, assemble, block, loft, mirrored, wheel
from actor_shapes.surfaces import ACCENT, GLASS, HEADLIGHT, PAINT, PLASTIC, TAILLIGHT, Surface
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.models.paint import DUST

LEVELS = 3  # sill, belt, top
LOWER, UPPER, TOP = 0, 1, 2

Station = tuple[float, float, float, float, float]
"""A cross-section: place along the length, heights of belt and top, widths at belt and top; as shares of the size."""


class Shape(NamedTuple):
    """A body.

    Attributes:
        name: name of the model.
        size_m: length, width, height.
        stations: cross-sections from the rear to the front; segment k lies between stations k and k + 1.
        glass_top: segments with a glazed top (rear window, windscreen).
        glass_sides: segment with glazed sides.
        cover: segment with a plastic cover on top (a pickup's bed).
    """

    name: str
    size_m: tuple[float, float, float]
    stations: tuple[Station, ...]
    glass_top: tuple[int, ...]
    glass_sides: int
    cover: int | None = None


# fmt: off
_NOSE: tuple[Station, ...] = ((0.955, 0.50, 0.60, 0.97, 0.80), (1.0, 0.42, 0.51, 0.84, 0.66))
_SNUB: tuple[Station, ...] = ((0.96, 0.44, 0.54, 0.96, 0.84), (1.0, 0.36, 0.46, 0.86, 0.72))
_TAIL: tuple[Station, ...] = ((0.0, 0.46, 0.96, 0.97, 0.86), (0.03, 0.48, 0.98, 1.0, 0.9))

_CARS = (
    Shape("sedan", (4.65, 1.80, 1.45), (
        (0.0, 0.56, 0.66, 0.86, 0.70), (0.035, 0.58, 0.70, 0.97, 0.80), (0.15, 0.60, 0.71, 1.0, 0.84),
        (0.30, 0.61, 0.98, 1.0, 0.68), (0.56, 0.61, 1.0, 1.0, 0.70), (0.76, 0.58, 0.69, 1.0, 0.86), *_NOSE,
    ), (2, 4), 3),
    Shape("hatchback", (4.30, 1.79, 1.48), (
        (0.0, 0.56, 0.64, 0.88, 0.78), (0.035, 0.60, 0.68, 0.98, 0.84), (0.12, 0.62, 0.96, 1.0, 0.68),
        (0.52, 0.61, 1.0, 1.0, 0.70), (0.74, 0.58, 0.68, 1.0, 0.86), *_NOSE,
    ), (1, 3), 2),
    Shape("estate", (4.75, 1.85, 1.47), (
        (0.0, 0.56, 0.64, 0.88, 0.78), (0.03, 0.60, 0.68, 0.98, 0.84), (0.085, 0.61, 0.97, 1.0, 0.70),
        (0.56, 0.60, 1.0, 1.0, 0.70), (0.77, 0.57, 0.68, 1.0, 0.86), *_NOSE,
    ), (1, 3), 2),
    Shape("suv", (4.60, 1.86, 1.69), (
        (0.0, 0.60, 0.68, 0.90, 0.80), (0.03, 0.62, 0.72, 0.98, 0.86), (0.075, 0.64, 0.97, 1.0, 0.74),
        (0.55, 0.62, 1.0, 1.0, 0.74), (0.73, 0.60, 0.70, 1.0, 0.88), (0.96, 0.55, 0.65, 0.97, 0.84),
        (1.0, 0.46, 0.56, 0.86, 0.74),
    ), (1, 3), 2),
    Shape("city_car", (3.57, 1.63, 1.49), (
        (0.0, 0.54, 0.62, 0.88, 0.78), (0.04, 0.58, 0.68, 0.98, 0.84), (0.16, 0.62, 0.95, 1.0, 0.68),
        (0.50, 0.60, 1.0, 1.0, 0.72), (0.74, 0.57, 0.70, 1.0, 0.84), (0.95, 0.50, 0.62, 0.95, 0.78),
        (1.0, 0.42, 0.54, 0.80, 0.60),
    ), (1, 3), 2),
    Shape("pickup", (5.35, 1.92, 1.85), (
        (0.0, 0.54, 0.61, 0.94, 0.88), (0.025, 0.55, 0.62, 0.99, 0.92), (0.34, 0.56, 0.63, 1.0, 0.93),
        (0.365, 0.60, 0.98, 1.0, 0.76), (0.60, 0.60, 1.0, 1.0, 0.76), (0.74, 0.57, 0.67, 1.0, 0.90),
        (0.965, 0.54, 0.64, 0.98, 0.86), (1.0, 0.46, 0.58, 0.88, 0.80),
    ), (2, 4), 3, cover=1),
)

_VANS = (
    Shape("small_van", (4.49, 1.86, 1.84), (
        *_TAIL, (0.45, 0.52, 1.0, 1.0, 0.88), (0.62, 0.52, 0.98, 1.0, 0.86), (0.80, 0.50, 0.60, 1.0, 0.88), *_SNUB,
    ), (3,), 2),
    Shape("panel_van", (4.90, 1.90, 1.99), (
        *_TAIL, (0.52, 0.50, 1.0, 1.0, 0.9), (0.70, 0.50, 0.98, 1.0, 0.88), (0.86, 0.48, 0.58, 1.0, 0.88), *_SNUB,
    ), (3,), 2),
    Shape("high_roof_van", (5.98, 2.06, 2.55), (
        *_TAIL, (0.60, 0.42, 1.0, 1.0, 0.90), (0.74, 0.42, 0.93, 1.0, 0.84), (0.87, 0.40, 0.47, 1.0, 0.88),
        (0.97, 0.36, 0.43, 0.96, 0.84), (1.0, 0.29, 0.37, 0.88, 0.74),
    ), (3,), 2),
)

_MINIVAN = Shape("minivan", (5.17, 2.02, 1.78), (
    (0.0, 0.54, 0.62, 0.90, 0.84), (0.03, 0.56, 0.68, 0.99, 0.88), (0.07, 0.57, 0.97, 1.0, 0.80),
    (0.58, 0.56, 1.0, 1.0, 0.80), (0.80, 0.52, 0.61, 1.0, 0.88), *_SNUB,
), (1, 3), 2)
# fmt: on


SHAPES = {shape.name: shape for shape in (*_CARS, *_VANS, _MINIVAN)}
"""All shapes by name."""


def make_cars() -> list[Model]:
    """Build six cars."""
    return [_plain(shape, ObjectClass.CAR) for shape in _CARS]


def make_vans() -> list[Model]:
    """Build four vans: for parcels, for goods, with a high roof, and for people."""
    return [_plain(shape, ObjectClass.VAN) for shape in (*_VANS, _MINIVAN)]


def _plain(shape: Shape, label: ObjectClass) -> Model:
    return assemble(shape.name, label, [vehicle_parts(shape, second_color(shape))], shape.size_m)


def second_color(shape: Shape) -> Dress:
    """Return what may have another colour: a car's roof, a van's sides below the belt; and a pickup's cover."""
    if shape in _VANS:
        segments = range(1, shape.glass_sides + 2)
        return {(segment, side): ACCENT for segment in segments for side in mirrored(LEVELS, LOWER)}
    roof = {(shape.glass_sides, TOP): ACCENT}
    return roof if shape.cover is None else {**roof, (shape.cover, TOP): PLASTIC}


def vehicle_parts(shape: Shape, dress: Dress, ends: tuple[Surface, Surface] | None = None) -> list[Part]:
    """Return body, grille and wheels of a car or van of about the shape's size.

    `dress` has surfaces by segment and side, as for `loft`, instead of the usual ones, `ends` those of rear and front.
    """
    (length, width, height), stations = shape.size_m, shape.stations
    last = len(stations) - 2
    panes = {(segment, TOP): GLASS for segment in shape.glass_top}
    panes |= {(shape.glass_sides, side): GLASS for side in mirrored(LEVELS, UPPER)}
    lamps = {
        (segment, side): lamp
        for segment, lamp in ((0, TAILLIGHT), (last, HEADLIGHT))
        for side in mirrored(LEVELS, UPPER)
    }
    clearance, half = 0.17, 0.488 * width
    outlines = [
        across(
            x * length,
            [(clearance, 0.94 * at_belt * half), (belt * height, at_belt * half), (top * height, at_top * half)],
        )
        for x, belt, top, at_belt, at_top in stations
    ]
    body = loft(outlines, PAINT, {**panes, **lamps, **dress}, ends)
    belt = stations[-1][1] * height
    grille = block((length - 0.05, length + 0.01), 0.28 * width, (clearance + 0.12, belt - 0.04), PLASTIC)
    return [body, grille, *_wheels(length, width, 0.19 * height + 0.04)]


def _wheels(length: float, width: float, radius: float) -> list[Part]:
    return [wheel(x * length, side * width / 2, radius, 0.22) for x in (0.19, 0.815) for side in (1, -1)]


_Extra = Callable[[Shape], list[Part]]

_OPENED: dict[_Extra, tuple[tuple[int, int], ...]] = {
    open_tailgate: ((0, TOP), (1, TOP), *((0, side) for side in mirrored(LEVELS, UPPER))),
    open_boot: ((0, TOP), (1, TOP)),
}
"""Faces, by segment and side, through which one looks inside."""


class _Variant(NamedTuple):
    """A car or van: its name, the name of its shape, its size, how often it is chosen, and what is different."""

    name: str
    shape: str
    size_m: tuple[float, float, float]
    share: float
    extras: tuple[_Extra, ...] = ()
    soiled: bool = False
    stands: bool = False


# fmt: off
_VARIED_CARS = (
    _Variant("microcar", "city_car", (2.70, 1.66, 1.56), 0.5),
    _Variant("small_hatchback", "hatchback", (4.07, 1.75, 1.46), 1.2),
    _Variant("small_hatchback_soiled", "hatchback", (3.85, 1.69, 1.50), 1.4, soiled=True),
    _Variant("coupe", "sedan", (4.52, 1.85, 1.30), 0.3),
    _Variant("compact_sedan", "sedan", (4.68, 1.80, 1.42), 0.7, soiled=True),
    _Variant("large_sedan", "sedan", (4.89, 1.84, 1.45), 0.9),
    _Variant("executive_sedan", "sedan", (4.95, 1.88, 1.47), 0.5, soiled=True),
    _Variant("limousine", "sedan", (5.29, 1.95, 1.50), 0.2),
    _Variant("compact_mpv", "estate", (4.53, 1.83, 1.66), 1.0),
    _Variant("small_suv", "suv", (4.35, 1.79, 1.62), 1.5),
    _Variant("small_suv_soiled", "suv", (4.24, 1.80, 1.60), 1.0, soiled=True),
    _Variant("off_roader", "suv", (4.79, 1.88, 1.86), 1.8, soiled=True),
    _Variant("mid_suv", "suv", (4.94, 2.00, 1.76), 3.0),
    _Variant("large_suv", "suv", (5.05, 2.00, 1.78), 1.8),
    _Variant("full_size_suv", "suv", (5.35, 2.06, 1.93), 1.6),
    _Variant("full_size_pickup", "pickup", (5.89, 2.03, 1.96), 0.3),
    _Variant("pickup_loaded", "pickup", (5.35, 1.92, 1.82), 0.2, (boxes_on_bed,)),
    _Variant("pickup_tarpaulin", "pickup", (5.40, 1.93, 1.83), 0.2, (bed_cover,), soiled=True),
    _Variant("pickup_hard_top", "pickup", (5.30, 1.90, 1.84), 0.3, (canopy,)),
    _Variant("estate_roof_box", "estate", (4.75, 1.85, 1.47), 0.3, (roof_box,)),
    _Variant("suv_roof_box", "suv", (4.70, 1.88, 1.70), 1.0, (roof_box,), soiled=True),
    _Variant("hatchback_bicycle", "hatchback", (4.28, 1.79, 1.48), 0.2, (rear_bicycle,)),
    _Variant("suv_bicycle", "suv", (4.60, 1.86, 1.69), 0.2, (rear_bicycle,)),
    _Variant("estate_tailgate_open", "estate", (4.75, 1.85, 1.47), 0.25, (open_tailgate,), stands=True),
    _Variant("suv_tailgate_open", "suv", (4.60, 1.86, 1.69), 0.25, (open_tailgate,), stands=True),
    _Variant("sedan_boot_open", "sedan", (4.70, 1.81, 1.45), 0.25, (open_boot,), stands=True),
    _Variant("hatchback_bonnet_open", "hatchback", (4.30, 1.79, 1.48), 0.1, (open_bonnet,), stands=True),
    _Variant("small_hatchback_door_open", "hatchback", (3.95, 1.70, 1.48), 0.3, (open_door,), stands=True),
    _Variant("city_car_door_open", "city_car", (3.57, 1.63, 1.49), 0.3, (open_door,), stands=True),
)

_VARIED_VANS = (
    _Variant("small_van_soiled", "small_van", (4.40, 1.85, 1.80), 1.5, soiled=True),
    _Variant("high_van", "panel_van", (4.84, 1.88, 2.11), 2.5),
    _Variant("long_panel_van", "panel_van", (5.34, 1.99, 2.30), 0.8, soiled=True),
    _Variant("mid_roof_van", "high_roof_van", (5.53, 2.06, 2.50), 2.0),
    _Variant("panel_van_ladder", "panel_van", (4.90, 1.90, 1.97), 0.5, (ladder,)),
    _Variant("long_panel_van_pipes", "panel_van", (5.30, 1.92, 1.98), 0.4, (pipes,), soiled=True),
    _Variant("small_van_ladder", "small_van", (4.49, 1.86, 1.84), 0.3, (ladder,), soiled=True),
    _Variant("people_carrier", "minivan", (5.18, 1.99, 1.76), 0.6),
    _Variant("minivan_roof_box", "minivan", (5.10, 2.00, 1.78), 0.3, (roof_box,)),
    _Variant("panel_van_doors_open", "panel_van", (4.90, 1.90, 1.99), 0.4, (open_rear_doors,), stands=True),
)
# fmt: on


def make_varied_cars() -> list[Model]:
    """Build the variants of cars, then those of vans."""
    cars = [_model(variant, ObjectClass.CAR) for variant in _VARIED_CARS]
    return cars + [_model(variant, ObjectClass.VAN) for variant in _VARIED_VANS]


def _model(variant: _Variant, label: ObjectClass) -> Model:
    base = SHAPES[variant.shape]
    dress, rear = dict(second_color(base)), PAINT
    if variant.soiled:
        dress.update(_soiled(base, dress))
        rear = Surface(0.6, 0.4, DUST)
    for extra in variant.extras:
        dress.update(dict.fromkeys(_OPENED.get(extra, ()), INSIDE))
    if open_tailgate in variant.extras or open_rear_doors in variant.extras:
        rear = INSIDE
    shape = base._replace(name=variant.name, size_m=variant.size_m)
    parts = vehicle_parts(shape, dress, (rear, PAINT)) + plates(shape, DIRTY_PLATE if variant.soiled else RETRO_PLATE)
    for extra in variant.extras:
        parts += extra(shape)
    return assemble(variant.name, label, [parts], share=variant.share, stands=variant.stands)


def _soiled(shape: Shape, dress: Dress) -> Dress:
    """Return dusty surfaces below the belt, of the color that each would have."""
    segments = range(len(shape.stations) - 1)
    sides = [(segment, side) for segment in segments for side in mirrored(LEVELS, LOWER)]
    return {place: Surface(0.6, 0.4, DUST, accented=dress.get(place) == ACCENT) for place in sides}
