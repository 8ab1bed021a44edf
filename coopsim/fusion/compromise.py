"""A box between two agents' boxes on one object, which overlaps the object whichever of them is right, if one can."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats

ON_OBJECT, _BLUR = 0.25, 0.03
"""3D IoU from which on a box is right, as the benchmark has it, and how softly it counts as right about there."""

_COMMON_GROUND = 0.7
"""Share of a box's footprint that the object's covers, of boxes that cover less of it than most."""

_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each][:, None] for each in np.triu_indices(len(_SHARES)))
"""How far up from the lower of two boxes to the higher one a floor and a roof may be, the roof at least as far."""

_TIE = 3e-3


def compromise(own: Boxes3D, other: Boxes3D, share: Floats) -> tuple[Floats, Floats]:
    """Boxes `share` (N,) of the way from own ones to another agent's, but for their heights.

    Floor and roof are those between which a box most likely overlaps the object enough, if the other box is right with
    the probability `share` and else the own one. Where the two differ little the mean overlaps both; where they differ
    more, a box in between, taller than either, does; where they differ by more than their own height and one is far
    likelier, that one is taken.

    Returns:
        Centre and size (N, 6) m, and the probability (N,) of overlapping the object enough if one of the two does.
    """
    extent: Floats = own.array[:, :6] + share[:, None] * (other.array[:, :6] - own.array[:, :6])
    floors = np.stack([bottom(own), bottom(other)])
    roofs = floors + np.stack([own.size[:, 2], other.size[:, 2]])
    order = np.argsort(floors, axis=0, kind="stable")
    low_to_high = (np.take_along_axis(each, order, axis=0) for each in (floors, roofs, np.stack([1 - share, share])))
    floors, roofs, chances = low_to_high
    floor = floors[0] + _FLOOR * (floors[1] - floors[0])
    roof = roofs[0] + _ROOF * (roofs[1] - roofs[0])
    right = np.zeros_like(floor)
    for its_floor, its_roof, chance in zip(floors, roofs, chances, strict=True):
        common = _COMMON_GROUND * np.maximum(np.minimum(roof, its_roof) - np.maximum(floor, its_floor), 0.0)
        overlap = common / (roof - floor + its_roof - its_floor - common)
        right += chance * expit((overlap - ON_OBJECT) / _BLUR)
    # Of equals the one nearest to the mean.
    best = (right - _TIE * ((_FLOOR - chances[1]) ** 2 + (_ROOF - chances[1]) ** 2)).argmax(axis=0)
    column = np.arange(len(share))
    extent[:, 2] = (floor + roof)[best, column] / 2
    extent[:, 5] = (roof - floor)[best, column]
    return extent, right[best, column]


def bottom(boxes: Boxes3D) -> Floats:
    """Height (N,) m of the undersides."""
    height: Floats = boxes.center[:, 2] - boxes.size[:, 2] / 2
    return height
