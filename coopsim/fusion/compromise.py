"""A box between two agents' boxes on one object, which overlaps the object whichever of them is right, if one can."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats

ON_OBJECT, _BLUR = 0.25, 0.03
"""3D IoU from which on a box is right, as the benchmark has it, and how softly it counts as right about there."""

_COMMON_GROUND = 0.85
"""Share of what two boxes cover together on the ground that is taken to be the object's: its own box is not quite
either of them."""

_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each][:, None] for each in np.triu_indices(len(_SHARES)))
"""How far up from the lower of two boxes to the higher one a floor and a roof may be, the roof at least as far."""

_CLOSER = 0.02
"""What an expected overlap of 1 is worth in probability: decides between boxes that are as likely right."""


def compromise(own: Boxes3D, other: Boxes3D, share: Floats) -> tuple[Boxes3D, Floats]:
    """Boxes between own ones and another agent's, each where it most likely overlaps the object enough.

    The other box is right with the probability `share`, and else the own one. Over ground a box is their mean, weighted
    by that, or, where the mean would miss both, half-way or either of the two; it has the heading of the likelier.
    Floor and roof are chosen apart, between those of the two: where they differ little the mean overlaps both; where
    they differ more, a box in between, taller than either, does; where they differ by more than their own height and
    one is far likelier, that one is taken.

    Args:
        own: N boxes.
        other: N boxes.
        share: (N,).

    Returns:
        The boxes, and (2, N) how likely each overlaps the object enough if the own box, and if the other one, is right.
    """
    floors = np.stack([own.bottom, other.bottom])
    order = np.argsort(floors, axis=0, kind="stable")
    lows, highs = (
        np.take_along_axis(each, order, axis=0)
        for each in (floors, floors + np.stack([own.size[:, 2], other.size[:, 2]]))
    )
    floor, roof = lows[0] + _FLOOR * (lows[1] - lows[0]), highs[0] + _ROOF * (highs[1] - highs[0])
    boxes = _between(own, other, share)
    overlaps = np.stack([_overlaps(boxes, floor, roof, each) for each in (own, other)])
    reaches: Floats = expit((overlaps - ON_OBJECT) / _BLUR)
    chances = np.stack([1 - share, share])[:, None, None]
    value = (chances * (reaches + _CLOSER * overlaps)).sum(axis=0)
    way, height = np.unravel_index(np.concatenate(value).argmax(axis=0), value.shape[:2])
    pair = np.arange(len(share))
    chosen = boxes[way, pair]
    chosen[:, 2], chosen[:, 5] = (floor + roof)[height, pair] / 2, (roof - floor)[height, pair]
    return Boxes3D.from_array(chosen), reaches[:, way, height, pair]


def _between(own: Boxes3D, other: Boxes3D, share: Floats) -> Floats:
    """Mean boxes over ground, own ones, other ones and those half-way, (4, N, 7), with the heading of the likelier."""
    ways = np.stack([share, np.zeros_like(share), np.ones_like(share), np.full_like(share, 0.5)])
    between = own.array + ways[..., None] * (other.array - own.array)
    between[..., 6] = np.where(share > 0.5, other.yaw, own.yaw)
    return between


def _overlaps(boxes: Floats, floor: Floats, roof: Floats, right: Boxes3D) -> Floats:
    """3D IoU (W, C, N) of `boxes` (W, N, 7) between floors and roofs (C, N) m with objects that `right` has found."""
    from_above = np.nan_to_num([np.diag(iou_bev(each, right.array)) for each in boxes])
    sides = np.stack(np.broadcast_arrays(boxes[..., 3:5], right.size[:, :2]))
    area, its_area = (sides / sides.max(axis=(0, 3))[..., None]).prod(axis=3)  # a scale cancels, and might overflow
    ground = _COMMON_GROUND * from_above * (area + its_area) / (1 + from_above)
    its_floor, its_height = right.bottom, right.size[:, 2]
    shared = np.maximum(np.minimum(roof, its_floor + its_height) - np.maximum(floor, its_floor), 0.0)
    common = ground[:, None] * shared
    union = (roof - floor) * area[:, None] + (its_height * its_area)[:, None] - common
    overlap: Floats = common / union
    return overlap
