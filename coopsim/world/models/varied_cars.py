"""Cars and vans of more sizes, soiled ones, and ones with things on them or open; all with number plates.

Sizes are those of well-known vehicles, without mirrors: Smart fortwo, VW Polo, Honda HR-V, Porsche 911, Honda Civic,
VW Touran, Jeep Wrangler, Toyota Camry, Mercedes E and S, BMW X5, Ford Explorer and F-150, Chevrolet Tahoe; Toyota
Hiace and Sienna, Ford Transit. Shares are such that sizes are spread as nuScenes' (see docs/reference/actors.md).
None is longer or wider than the largest plain van, so that all have room where vehicles park.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.attachments import (
    DIRTY_PLATE,
    RETRO_PLATE,
    bed_cover,
    boxes_on_bed,
    canopy,
    ladder,
    pipes,
    plates,
    rear_bicycle,
    roof_box,
)
from coopsim.world.models.cars import LEVELS, LOWER, SHAPES, TOP, UPPER, Shape, second_color, vehicle_parts
from coopsim.world.models.model import Model
from coopsim.world.models.openings import INSIDE, open_bonnet, open_boot, open_door, open_rear_doors, open_tailgate
from coopsim.world.models.paint import DUST
from coopsim.world.models.parts import ACCENT, PAINT, Dress, Part, Surface, assemble, mirrored

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
_CARS = (
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

_VANS = (
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
    cars = [_model(variant, ObjectClass.CAR) for variant in _CARS]
    return cars + [_model(variant, ObjectClass.VAN) for variant in _VANS]


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
    return replace(assemble(variant.name, label, [parts]), share=variant.share, stands=variant.stands)


def _soiled(shape: Shape, dress: Dress) -> Dress:
    """Return dusty surfaces below the belt, of the color that each would have."""
    segments = range(len(shape.stations) - 1)
    sides = [(segment, side) for segment in segments for side in mirrored(LEVELS, LOWER)]
    return {place: Surface(0.6, 0.4, DUST, accented=dress.get(place) == ACCENT) for place in sides}
