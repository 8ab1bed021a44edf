"""Number plates, roof boxes, bicycles, ladders, loads, and open lids and doors of cars and vans.

Each function takes the vehicle's `Shape` and returns parts in its frame: the rear bumper at x = 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from actor_shapes.parts import Part, across, block, loft, tube
from actor_shapes.surfaces import ACCENT, GLASS, METAL, PAINT, PLASTIC, TYRE, Surface
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

if TYPE_CHECKING:
    from actor_shapes.cars import Shape

RETRO_PLATE = Surface(0.0, 220.0, (234, 234, 226))
DIRTY_PLATE = Surface(0.0, 30.0, (150, 140, 120))
"""Plates of at least 70 cd/(lx m2), class RA1 of EN 12899-1, send back 220 times as much as white, 1/pi; under dirt, a
seventh (assumed by us)."""

WOOD = Surface(0.0, 0.5, (172, 134, 88))
TARPAULIN = Surface(0.0, 0.45, (60, 92, 122))

_PLATE_HALF_M, _PLATE_HEIGHT_M = 0.26, 0.11


def plate(x: float, z: float, outwards: float, surface: Surface = RETRO_PLATE, half_m: float = _PLATE_HALF_M) -> Part:
    """Build a number plate that looks forward (`outwards` 1) or back (-1): a prism, flat on the outside."""
    edge = [(x, z), (x, z + _PLATE_HEIGHT_M), (x - 0.03 * outwards, z + _PLATE_HEIGHT_M / 2)]
    return loft([[(along, y, up) for along, up in edge] for y in (half_m, -half_m)], surface)


def plates(shape: Shape, surface: Surface = RETRO_PLATE) -> list[Part]:
    """Build the plates at both ends."""
    length = shape.size_m[0]
    return [plate(-0.015, 0.5, -1.0, surface), plate(length + 0.02, 0.36, 1.0, surface)]


def roof_box(shape: Shape) -> list[Part]:
    """Build a box of 1.9 m on the roof."""
    (_, width, height), (rear, front) = shape.size_m, roof(shape)
    middle = (rear + front) / 2
    ends = [max(rear, middle - 0.85), middle + 0.85]
    outlines = [
        across(x, [(height + up, wide * width), (height + 0.06 + high, 0.92 * wide * width)])
        for x, up, high, wide in (
            (ends[0], 0.02, 0.30, 0.20),
            (ends[1] - 0.5, 0.02, 0.36, 0.21),
            (ends[1], 0.06, 0.12, 0.15),
        )
    ]
    return [loft(outlines, PLASTIC), *_bars(shape, 0.04)]


def ladder(shape: Shape) -> list[Part]:
    """Build a ladder on a rack."""
    rear, front = roof(shape)
    z, half = shape.size_m[2] + 0.10, 0.17
    rails = [block((rear + 0.1, front + 0.3), 0.03, (z, z + 0.08), METAL, 0.25 + side * half) for side in (1, -1)]
    rungs = [
        tube([[x, 0.25 - half, z + 0.04], [x, 0.25 + half, z + 0.04]], [0.02, 0.02], METAL, 3)
        for x in np.linspace(rear + 0.4, front, 4)
    ]
    return [*rails, *rungs, *_bars(shape, 0.11)]


def pipes(shape: Shape) -> list[Part]:
    """Build a bundle of pipes on a rack."""
    rear, front = roof(shape)
    z = shape.size_m[2] + 0.16
    bundle = [
        tube([[rear, y, z + up], [front + 0.4, y, z + up]], [0.06, 0.06], surface, 5)
        for y, up, surface in ((0.3, 0.0, METAL), (0.16, 0.0, WOOD), (0.23, 0.11, METAL))
    ]
    return [*bundle, *_bars(shape, 0.11)]


def rear_bicycle(shape: Shape) -> list[Part]:
    """Build a bicycle across the rear, on a carrier."""
    z, x, frame = 0.56, -0.22, Surface(0.0, 0.5, (36, 110, 150))
    wheels = [_wheel_across(x, y, z + 0.33, 0.33) for y in (0.5, -0.5)]
    bars = [
        ((0.5, 0.33), (0.1, 0.28)),
        ((0.1, 0.28), (-0.3, 0.78)),
        ((0.5, 0.33), (0.28, 0.8)),
        ((0.28, 0.7), (-0.3, 0.78)),
    ]
    bars += [((-0.5, 0.33), (-0.3, 0.9))]
    tubes = [tube([[x, a, z + b], [x, c, z + d]], [0.025, 0.025], frame, 3) for (a, b), (c, d) in bars]
    return [*wheels, *tubes, block((x - 0.08, 0.1), 0.6, (z - 0.08, z - 0.02), PLASTIC)]


def boxes_on_bed(shape: Shape) -> list[Part]:
    """Build crates on a pickup's bed, up to over the cab."""
    (_, width, height), (low, end) = shape.size_m, _bed(shape)
    half = 0.36 * width
    return [
        block((0.15, 0.55 * end), half, (low, low + 0.55), WOOD),
        block((0.58 * end, end - 0.1), 0.8 * half, (low, height + 0.12), ACCENT, 0.1),
        block((0.25, 0.5 * end), 0.5 * half, (low + 0.55, low + 0.85), PLASTIC, -0.15),
    ]


def bed_cover(shape: Shape) -> list[Part]:
    """Build a hump of tarpaulin over a pickup's bed."""
    (_, width, height), (low, end) = shape.size_m, _bed(shape)
    outlines = [
        across(x, [(low, 0.42 * width), (low + (height - low) * up, 0.30 * width)])
        for x, up in ((0.08, 0.25), (0.35 * end, 0.9), (0.7 * end, 1.0), (end - 0.05, 0.8))
    ]
    return [loft(outlines, TARPAULIN)]


def canopy(shape: Shape) -> list[Part]:
    """Build a hard top over a pickup's bed, as high as the cab."""
    (_, width, height), (low, end) = shape.size_m, _bed(shape)
    outlines = [across(x, [(low, 0.45 * width), (0.97 * height, 0.36 * width)]) for x in (0.05, end)]
    return [loft(outlines, PAINT, ends=(GLASS, PAINT))]


def roof(shape: Shape) -> tuple[float, float]:
    """Return the rear and front end of the roof, in metres along x."""
    high = [station[0] for station in shape.stations if station[2] > 0.9]
    return high[0] * shape.size_m[0], high[-1] * shape.size_m[0]


def _bed(shape: Shape) -> tuple[float, float]:
    """Return the height of a pickup's bed and its front end, in metres."""
    x, _, top, *_ = shape.stations[2]
    return top * shape.size_m[2] - 0.02, x * shape.size_m[0]


def _bars(shape: Shape, above_m: float) -> list[Part]:
    rear, front = roof(shape)
    z, half = shape.size_m[2], 0.33 * shape.size_m[1]
    places = (rear + 0.25 * (front - rear), rear + 0.8 * (front - rear))
    return [block((x - 0.03, x + 0.03), half, (z - 0.04, z + above_m), PLASTIC) for x in places]


def hoop(hub: Floats, radius: float, sides: int = 12) -> Part:
    """Build a tyre of triangular section, without spokes."""
    turn = np.arange(sides) * 2 * np.pi / sides + np.pi / sides
    spoke = np.stack([exact.cos(turn), np.zeros(sides), exact.sin(turn)], axis=1)
    rings = [
        hub + radius * spoke,
        hub + 0.92 * radius * spoke + [0, 0.022, 0],
        hub + 0.92 * radius * spoke - [0, 0.022, 0],
    ]
    return loft(np.stack(rings, axis=1), TYRE, ring=True)


def _wheel_across(x: float, y: float, z: float, radius: float, sides: int = 8) -> Part:
    """Build a bicycle's tyre that stands across the vehicle."""
    turn = np.arange(sides) * 2 * np.pi / sides
    spoke = np.stack([np.zeros(sides), exact.cos(turn), exact.sin(turn)], axis=1)
    hub = np.array([x, y, z])
    rings = [
        hub + radius * spoke,
        hub + 0.9 * radius * spoke + [0.025, 0, 0],
        hub + 0.9 * radius * spoke - [0.025, 0, 0],
    ]
    return loft(np.stack(rings, axis=1), TYRE, ring=True)


INSIDE = Surface(0.0, 0.12, (30, 30, 33))

_THICK_M = 0.04
_DOOR_M, _AJAR_RAD = 1.02, 0.38


def open_tailgate(shape: Shape) -> list[Part]:
    """Build a tailgate, raised from the rear edge of the roof."""
    _, width, height = shape.size_m
    x, _ = roof(shape)
    return [_slab((x, 0.97 * height), (-0.95, 0.28), 0.36 * width, 0.33 * width)]


def open_boot(shape: Shape) -> list[Part]:
    """Build a saloon's boot lid, upright."""
    (length, width, height), (x, _, top, *_) = shape.size_m, shape.stations[2]
    return [_slab((x * length + 0.08, top * height), (-0.12, 0.62), 0.40 * width, 0.36 * width)]


def open_bonnet(shape: Shape) -> list[Part]:
    """Build a bonnet, raised at its front edge."""
    (length, width, height), (x, _, top, *_) = shape.size_m, shape.stations[-3]
    return [_slab((x * length, top * height), (0.5, 0.62), 0.42 * width, 0.36 * width)]


def open_rear_doors(shape: Shape) -> list[Part]:
    """Build the two rear doors of a van, which stand straight back."""
    (_, width, height) = shape.size_m
    low, high, half = 0.25, 0.93 * height, 0.43 * width
    return [block((-0.82, 0.02), 0.02, (low, high), PAINT, side * half) for side in (1, -1)]


def open_door(shape: Shape) -> list[Part]:
    """Build the driver's door, ajar, with its window."""
    length, width, height = shape.size_m
    belt = shape.stations[-3][1] * height + 0.04
    hinge = np.array([0.69 * length, 0.487 * width])
    along = _DOOR_M * np.array([-exact.cos(_AJAR_RAD), exact.sin(_AJAR_RAD)])
    inwards = _THICK_M * np.array([-exact.sin(_AJAR_RAD), -exact.cos(_AJAR_RAD)])
    outlines = []
    for z, gone, lean_m in ((0.24, 0.0, 0.0), (belt, 0.0, 0.0), (0.93 * height, 0.33, 0.14)):
        front, rear = (hinge + share * along - [0.0, lean_m] for share in (gone, 1.0))
        outlines.append([(*corner, z) for corner in (front, rear, rear + inwards, front + inwards)])
    return [loft(outlines, PAINT, {(1, 0): INSIDE, (1, 2): INSIDE})]


def _slab(hinge: tuple[float, float], reach: tuple[float, float], half: float, end_half: float) -> Part:
    """Build a lid from a hinge (x, z) by `reach` (x, z), so wide at the hinge and at its end."""
    start, along = np.array(hinge), np.array(reach)
    thick = _THICK_M * np.array([along[1], -along[0]]) / exact.norm(along)
    outlines = []
    for (x, z), side in ((start, half), (start + along, end_half)):
        outlines.append(
            [(x, side, z), (x + thick[0], side, z + thick[1]), (x + thick[0], -side, z + thick[1]), (x, -side, z)]
        )
    return loft(outlines, PAINT)
