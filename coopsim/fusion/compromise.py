"""A box between two agents' boxes on one object, that overlaps the object whichever of them is right, if possible."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats

ON_OBJECT, _BLUR = 0.25, 0.03
"""3D IoU from which a box is right, as in the benchmark, and the width of the soft threshold around it."""

_COMMON_GROUND = 0.85
"""Share of the common ground of two boxes that counts as the object's: its own box is not quite either of them."""

_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each][:, None] for each in np.triu_indices(len(_SHARES)))
"""Candidate floors and roofs, as shares of the way from the lower box to the higher one, the roof at least as far."""

_CLOSER = 0.02
"""Worth of an expected overlap of 1 in probability: decides between boxes that are equally likely right."""


def compromise(own: Boxes3D, other: Boxes3D, other_right: Floats) -> tuple[Boxes3D, Floats]:
    """Place boxes between own ones and another agent's, each where it most likely overlaps the object enough.

    Over ground a box is the mean of the two, weighted by their probabilities, or, where the mean would miss both,
    half-way or either of the two; it has the heading of the likelier one. Floor and roof are chosen separately, between
    those of the two: where they differ little the mean overlaps both; where they differ more, a box in between, taller
    than either, does; where they differ by more than their own height and one is far likelier, that one is taken.

    Args:
        own: N boxes.
        other: N boxes.
        other_right: (N,) probability that the other box is right; else the own one is.

    Returns:
        The boxes, and the probabilities (2, N) that each overlaps the object enough if the own box, and if the other
        one, is right.
    """
    floors = np.stack([own.bottom, other.bottom])
    order = np.argsort(floors, axis=0, kind="stable")
    lows, highs = (
        np.take_along_axis(each, order, axis=0)
        for each in (floors, floors + np.stack([own.size[:, 2], other.size[:, 2]]))
    )
    floor, roof = lows[0] + _FLOOR * (lows[1] - lows[0]), highs[0] + _ROOF * (highs[1] - highs[0])
    boxes = _between(own, other, other_right)
    overlaps = np.stack([_overlaps(boxes, floor, roof, each) for each in (own, other)])
    reaches: Floats = expit((overlaps - ON_OBJECT) / _BLUR)
    chances = np.stack([1 - other_right, other_right])[:, None, None]
    value = (chances * (reaches + _CLOSER * overlaps)).sum(axis=0)
    way, height = np.unravel_index(np.concatenate(value).argmax(axis=0), value.shape[:2])
    pair = np.arange(len(other_right))
    chosen = boxes[way, pair]
    chosen[:, 2], chosen[:, 5] = (floor + roof)[height, pair] / 2, (roof - floor)[height, pair]
    return Boxes3D.from_array(chosen), reaches[:, way, height, pair]


def _between(own: Boxes3D, other: Boxes3D, other_right: Floats) -> Floats:
    """Return mean, own, other and half-way boxes over ground (4, N, 7), with the heading of the likelier one."""
    ways = np.stack(
        [other_right, np.zeros_like(other_right), np.ones_like(other_right), np.full_like(other_right, 0.5)]
    )
    between = own.array + ways[..., None] * (other.array - own.array)
    between[..., 6] = np.where(other_right > 0.5, other.yaw, own.yaw)
    return between


def _overlaps(boxes: Floats, floor: Floats, roof: Floats, right: Boxes3D) -> Floats:
    """Return the 3D IoU (W, C, N) of `boxes` (W, N, 7), between floors and roofs (C, N) m, with the right boxes."""
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
