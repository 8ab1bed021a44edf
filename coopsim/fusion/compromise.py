"""A box between two agents' boxes on one object, that overlaps the object whichever of them is right, if possible."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.iou import Footprint, common_ground, corner_space
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

ON_OBJECT, _BLUR = 0.25, 0.03
"""3D IoU from which a box is right, as in the benchmark, and the width of the soft threshold around it."""

_COMMON_GROUND = 0.85
"""Share of the common ground of two boxes that counts as the object's: its own box is not quite either of them."""

_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each] for each in np.triu_indices(len(_SHARES)))
"""Candidate floors and roofs, as shares of the way from the lower box to the higher one, the roof at least as far."""

_CLOSER = 0.02
"""Worth of an expected overlap of 1 in probability: decides between boxes that are equally likely right."""

_Ground = tuple[float, float, float]
"""Area that a candidate shares over ground with a box that may be right, its own area, and that box's area. Their unit
is the candidate's own: it cancels, and squares of m might overflow."""


class Workspace(NamedTuple):
    """Arrays that `compromise` writes to, to be used for one pair of boxes after another.

    Attributes:
        corners: from `corner_space`.
        floor: (C,) m, of each candidate.
        height: (C,) m, of each candidate.
        shared: (2, C) m of height that each candidate shares with the own box and with the other one.
        overlap: (2, C) 3D IoU of each candidate with the own box and with the other one.
    """

    corners: Floats
    floor: Floats
    height: Floats
    shared: Floats
    overlap: Floats


@njit(cache=True, nogil=True)
def workspace() -> Workspace:
    """Return a workspace."""
    count = len(_FLOOR)
    return Workspace(corner_space(), np.empty(count), np.empty(count), np.empty((2, count)), np.empty((2, count)))


@njit(cache=True, nogil=True)
def compromise(own: Floats, other: Floats, other_right: float, chosen: Floats, room: Workspace) -> tuple[float, float]:
    """Place a box between the own one and another agent's, where it most likely overlaps the object enough.

    Over ground it is the mean of the two, weighted by their probabilities, or, where the mean would miss both,
    half-way or either of the two; it has the heading of the likelier one. Floor and roof are chosen separately, between
    those of the two: where they differ little the mean overlaps both; where they differ more, a box in between, taller
    than either, does; where they differ by more than their own height and one is far likelier, that one is taken.

    Args:
        own: (7 or more,) the own box.
        other: (7 or more,) the other one.
        other_right: probability that the other box is right; else the own one is.
        chosen: (7 or more,) array to write the box to.
        room: a workspace.

    Returns:
        The probabilities that it overlaps the object enough if the own box is right, and if the other one is.
    """
    _raise_candidates(own, other, room)
    one, two = footprint(own), footprint(other)
    likelier = two if other_right > 0.5 else one
    best, best_own, best_other = -np.inf, -np.inf, -np.inf
    own_overlap, other_overlap = room.overlap[0], room.overlap[1]
    for way in (other_right, 0.0, 1.0, 0.5):
        between = _between(one, two, way, likelier)
        own_ground, other_ground = _ground(between, one, room.corners), _ground(between, two, room.corners)
        if _value(_most(own_ground), _most(other_ground), other_right) < best:
            continue
        _overlaps(own_ground, own[5], room.height, room.shared[0], own_overlap)
        _overlaps(other_ground, other[5], room.height, room.shared[1], other_overlap)
        for k in range(len(own_overlap)):
            if own_overlap[k] <= best_own and other_overlap[k] <= best_other:
                continue
            expected = (1 - other_right) * own_overlap[k] + other_right * other_overlap[k]
            if 1.0 + _CLOSER * expected < best:  # not even if it surely is enough
                continue
            value = _value(own_overlap[k], other_overlap[k], other_right)
            if value > best:
                best, best_own, best_other = value, own_overlap[k], other_overlap[k]
                chosen[0], chosen[1], chosen[3], chosen[4] = between[0], between[1], between[2], between[3]
                chosen[2], chosen[5] = room.floor[k] + room.height[k] / 2, room.height[k]
    chosen[6] = other[6] if other_right > 0.5 else own[6]
    return _reached(best_own), _reached(best_other)


@njit(cache=True, nogil=True)
def _raise_candidates(own: Floats, other: Floats, room: Workspace) -> None:
    """Compute floors and heights of all candidates, and the heights that they share with either box."""
    floor, height, with_own, with_other = room.floor, room.height, room.shared[0], room.shared[1]
    own_floor, other_floor = own[2] - own[5] / 2, other[2] - other[5] / 2
    own_roof, other_roof = own_floor + own[5], other_floor + other[5]
    low_floor, low_roof, high_floor, high_roof = own_floor, own_roof, other_floor, other_roof
    if other_floor < own_floor:
        low_floor, low_roof, high_floor, high_roof = other_floor, other_roof, own_floor, own_roof
    for k in range(len(floor)):
        floor[k] = low_floor + _FLOOR[k] * (high_floor - low_floor)
        roof = low_roof + _ROOF[k] * (high_roof - low_roof)
        height[k] = roof - floor[k]
        with_own[k] = max(min(roof, own_roof) - max(floor[k], own_floor), 0.0)
        with_other[k] = max(min(roof, other_roof) - max(floor[k], other_floor), 0.0)


@njit(cache=True, nogil=True)
def footprint(box: Floats) -> Footprint:
    """Return the footprint of a box (7,)."""
    return box[0], box[1], box[3], box[4], np.cos(box[6]), np.sin(box[6])


@njit(cache=True, nogil=True)
def _between(own: Footprint, other: Footprint, way: float, likelier: Footprint) -> Footprint:
    """Return the footprint that is a share of the way from the own one to the other, with the likelier's heading."""
    return (
        own[0] + way * (other[0] - own[0]),
        own[1] + way * (other[1] - own[1]),
        own[2] + way * (other[2] - own[2]),
        own[3] + way * (other[3] - own[3]),
        likelier[4],
        likelier[5],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _ground(candidate: Footprint, right: Footprint, room: Floats) -> _Ground:
    """Return the ground that a candidate shares with a box that may be right."""
    unit = max(candidate[2], candidate[3], right[2], right[3])
    area = (candidate[2] / unit) * (candidate[3] / unit)
    its_area = (right[2] / unit) * (right[3] / unit)
    shared = common_ground(candidate, right, room)
    iou = shared / (candidate[2] * candidate[3] + right[2] * right[3] - shared)
    iou = iou if np.isfinite(iou) else 0.0
    return _COMMON_GROUND * iou * (area + its_area) / (1 + iou), area, its_area


@njit(cache=True, nogil=True, error_model="numpy")
def _overlaps(ground: _Ground, right_height: float, height: Floats, shared_height: Floats, overlap: Floats) -> None:
    """Compute the 3D IoU (C,) of candidates of some heights (C,) m with the box that may be right."""
    shared, area, its_area = ground
    its_volume = right_height * its_area
    for k in range(len(height)):
        common = shared * shared_height[k]
        overlap[k] = common / (height[k] * area + its_volume - common)


@njit(cache=True, nogil=True, error_model="numpy")
def _most(ground: _Ground) -> float:
    """Return the largest 3D IoU of all candidates over this ground: that of one with the right floor and roof."""
    shared, area, its_area = ground
    return shared / (area + its_area - shared)


@njit(cache=True, nogil=True)
def _value(own_overlap: float, other_overlap: float, other_right: float) -> float:
    own_value = (1 - other_right) * (_reached(own_overlap) + _CLOSER * own_overlap)
    return own_value + other_right * (_reached(other_overlap) + _CLOSER * other_overlap)


@njit(cache=True, nogil=True, error_model="numpy")
def _reached(overlap: float) -> float:
    """Return the probability that a box with this 3D IoU with the right one overlaps the object enough."""
    probability: float = 1 / (1 + np.exp(-(overlap - ON_OBJECT) / _BLUR))
    return probability
