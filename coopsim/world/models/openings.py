"""Open lids and doors of parked cars and vans: parts in the vehicle's frame, the rear bumper at x = 0."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.world.models.attachments import roof
from coopsim.world.models.cars import Shape
from coopsim.world.models.parts import PAINT, Part, Surface, block, loft

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
