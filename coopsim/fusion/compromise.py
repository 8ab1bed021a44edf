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
"""What a floor or a roof all the way off the mean costs in probability: decides between heights that are as likely."""


def compromise(own: Boxes3D, other: Boxes3D, share: Floats) -> tuple[Floats, Floats]:
    """Boxes `share` (N,) of the way from own ones to another agent's, but for their heights.

    Floor and roof are those between which a box most likely overlaps the object enough, if the other box is right with
    the probability `share` and else the own one. Where the two differ little the mean overlaps both; where they differ
    more, a box in between, taller than either, does; where they differ by more than their own height and one is far
    likelier, that one is taken.

    Returns:
        Centre and size (N, 6) m, and (2, N) how likely each overlaps the object enough if the own box, and if the other
        one, is right.
    """
    extent: Floats = own.array[:, :6] + share[:, None] * (other.array[:, :6] - own.array[:, :6])
    floors = np.stack([bottom(own), bottom(other)])
    roofs, chances = floors + np.stack([own.size[:, 2], other.size[:, 2]]), np.stack([1 - share, share])
    order = np.argsort(floors, axis=0, kind="stable")
    (low_m, high_m), (low_roof_m, high_roof_m), (_, of_higher) = (
        np.take_along_axis(each, order, axis=0) for each in (floors, roofs, chances)
    )
    floor = low_m + _FLOOR * (high_m - low_m)
    roof = low_roof_m + _ROOF * (high_roof_m - low_roof_m)
    reaches = np.stack([_reaches(floor, roof, *each) for each in zip(floors, roofs, strict=True)])
    right = (chances[:, None] * reaches).sum(axis=0)
    # Of equals the one nearest to the mean.
    best = (right - _TIE * ((_FLOOR - of_higher) ** 2 + (_ROOF - of_higher) ** 2)).argmax(axis=0)
    column = np.arange(len(share))
    extent[:, 2] = (floor + roof)[best, column] / 2
    extent[:, 5] = (roof - floor)[best, column]
    return extent, reaches[:, best, column]


def _reaches(floor: Floats, roof: Floats, its_floor: Floats, its_roof: Floats) -> Floats:
    """How likely boxes between floors and roofs (C, N) m overlap an object enough whose own are (N,) m."""
    common = _COMMON_GROUND * np.maximum(np.minimum(roof, its_roof) - np.maximum(floor, its_floor), 0.0)
    overlap = common / (roof - floor + its_roof - its_floor - common)
    likely: Floats = expit((overlap - ON_OBJECT) / _BLUR)
    return likely


def bottom(boxes: Boxes3D) -> Floats:
    """Height (N,) m of the undersides."""
    height: Floats = boxes.center[:, 2] - boxes.size[:, 2] / 2
    return height
