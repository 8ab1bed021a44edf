"""Fusion of several agents' boxes, weighted by how likely each agent is right about an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.fusion.compromise import compromise, footprint, workspace
from coopsim.fusion.fused_boxes import (
    AWAY,
    BEST,
    CHANCE,
    NEAREST,
    SCORE,
    FusedBoxes,
    FusedRows,
    SourceOdds,
    away,
    clear_middle,
    column,
    first_of,
    of_agent,
    pair_features,
    probability_other,
    put,
    room_for,
    take,
)
from coopsim.fusion.registration import register_rows
from coopsim.geometry.iou import iou_3d_of_pair
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_probability
from coopsim.support.kernels import njit
from coopsim.types import Detections, Ints
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import drop_invalid


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """The pairs of two agents' boxes on the same objects.

    Attributes:
        own: (K,) rows of the own boxes that the other agent sees too.
        other: (K,) the other agent's rows of those objects.
        new: (L,) the other agent's rows of objects that only it sees.
        expected: (L,) boxes of those as registration expects the receiver's sensor to see them; None without common
            objects to register by.
    """

    own: Ints
    other: Ints
    new: Ints
    expected: FusedBoxes | None


def correspond(own: FusedBoxes, other: FusedBoxes, gate: float) -> Correspondence:
    """Match two agents' boxes under their registration, which removes a common error of a pose or a clock."""
    mine, theirs, new, common, expected = correspond_rows(own.rows, other.rows, float(gate))
    return Correspondence(mine, theirs, new, FusedBoxes.of_rows(expected, other.detections) if common else None)


def trust_likelier(
    groups: Sequence[Detections],
    gate: float,
    doubt: SourceOdds,
    hearsay: SourceOdds | None = None,
    least_chance: float = 1.0,
) -> FusedBoxes:
    """Fuse the agents' boxes to one box per object, where it is most likely right.

    Each group is matched to the fused boxes of the groups before (Hungarian on the BEV GIoU, per class, after
    registration), and unmatched boxes are added. A fused box has the heading, covariance and embedding of the likelier
    one, the best score of all, and lies where it most likely overlaps the object (`compromise`). Where it may miss the
    object although one of the two is right, that one may be kept as a box of its own, at the end, with the remaining
    chance.

    Objects that the receiver does not see itself are treated alike: they may lie where the other agent places them, or
    where registration expects the receiver to see them.

    Args:
        groups: one per agent, in one frame, the receiver's own first. Invalid boxes are dropped.
        gate: smallest BEV GIoU of boxes on one object, in [-1, 1].
        doubt: weights for boxes of objects that both agents see.
        hearsay: weights for boxes of objects that only another agent sees; None: they are trusted.
        least_chance: smallest chance, in [0, 1], that a replaced box is right where the fused one is not, from which it
            is kept; 1: none is.
    """
    require_between(-1, 1, gate=gate)
    require_probability(least_chance=least_chance)
    valid = _valid(groups)
    weights = np.zeros(0) if hearsay is None else hearsay.weights
    joined = valid.joined
    boxes = joined.boxes.array
    score, label = np.ascontiguousarray(joined.score), np.ascontiguousarray(joined.label)  # one layout is compiled
    found = fuse_groups(boxes, score, label, valid.starts, float(gate), doubt.weights, weights, float(least_chance))
    return FusedBoxes.of_rows(found, joined)


def _valid(groups: Sequence[Detections]) -> DetectionGroups:
    """Return the valid boxes of all groups, end to end."""
    joined = DetectionGroups.of(groups)
    if joined.parts is None and drop_invalid(joined.joined) is joined.joined:
        return joined
    return DetectionGroups.of([drop_invalid(each) for each in groups])


_EVEN_ODDS_IOU, _STEEPNESS = 0.255, 6.4
"""Log odds that a box is on its object, linear in the logarithm of its 3D IoU with a right box. In the training
recordings of V2V4Real boxes between two agents' were on their object in 31 % of cases at an IoU of 0.2 to 0.25, in 64 %
in the next 0.05, then in 85, 92 and 96 %."""


@njit(cache=True, nogil=True)
def fuse_groups(
    boxes: Floats,
    score: Floats,
    label: Ints,
    starts: Ints,
    gate: float,
    doubt: Floats,
    hearsay: Floats,
    least_chance: float,
) -> FusedRows:
    """Fuse the boxes of G agents, as `trust_likelier` says.

    Args:
        boxes: (N, 7) valid boxes of all agents.
        score: (N,) their scores.
        label: (N,) their classes.
        starts: (G + 1,) agent g has the rows from starts[g] to starts[g + 1] - 1.
        gate: smallest BEV GIoU of boxes on one object.
        doubt: (7,) weights of a `SourceOdds`, for boxes of objects that both agents see.
        hearsay: (7,) weights for boxes of objects that only another agent sees; (0,): they are trusted.
        least_chance: smallest chance of a replaced box that is kept.

    Returns:
        The fused boxes, then the replaced ones that are kept.
    """
    fused, count = room_for(3 * len(boxes)), 0
    replaced, spared = room_for(2 * len(boxes)), 0
    for g in range(len(starts) - 1):
        first, last = starts[g], starts[g + 1]
        if first == last:
            continue
        other = of_agent(boxes[first:last], score[first:last], label[first:last], first)
        mine, theirs, new, common, expected = correspond_rows(first_of(fused, count), other, gate)
        agreed, spare = _fuse(take(fused, mine), take(other, theirs), doubt)
        for k in range(len(mine)):
            put(fused, mine[k], agreed, k)
        spared = _keep(replaced, spared, spare, least_chance)
        alone = take(other, new)
        if len(hearsay) and common:
            alone, spare = _fuse(expected, alone, hearsay)
            spared = _keep(replaced, spared, spare, least_chance)
        for k in range(len(new)):
            put(fused, count + k, alone, k)
        count += len(new)
    for k in range(spared):
        put(fused, count + k, replaced, k)
    return first_of(fused, count + spared)


@njit(cache=True, nogil=True)
def correspond_rows(own: FusedRows, other: FusedRows, gate: float) -> tuple[Ints, Ints, Ints, int, FusedRows]:
    """Match two agents' boxes under their registration, as `correspond` says.

    Returns:
        The rows (K,) of the own boxes that the other agent sees too, rising, and its rows (K,) of those objects; its
        rows (L,) of objects that only it sees; the number of objects by which the boxes were registered; and the L
        boxes as registration expects the receiver's sensor to see them.
    """
    best = column(own, BEST)
    registration, placed, own_row, giou = register_rows(
        own.boxes, best, own.label, other.boxes, column(other, BEST), other.label
    )
    other_row = np.full(len(own.label), -1)
    seen = giou >= gate
    for k in range(len(other.label)):
        if seen[k]:
            other_row[own_row[k]] = k
    mine, new = np.flatnonzero(other_row >= 0), np.flatnonzero(~seen)
    # No agent detected them there: the score is 0, and only the distance is from the receiver's clear area.
    boxes, values = placed[new], other.values[new]
    values[:, AWAY] = away(boxes, clear_middle(own.boxes, best))
    values[:, SCORE] = 0.0
    expected = FusedRows(boxes, values, other.label[new], other.origin[new])
    return mine, other_row[mine], new, registration.common, expected


@njit(cache=True, nogil=True)
def _fuse(own: FusedRows, other: FusedRows, doubt: Floats) -> tuple[FusedRows, FusedRows]:
    """Fuse N pairs of boxes.

    Returns:
        The fused boxes (N,), and the pairs' originals (2 N,), all own ones first, each with the probability that it is
        right where the fused box is not as its chance.
    """
    count, room = len(own.label), workspace()
    fused, spare = room_for(count), room_for(2 * count)
    other_right = _probability_other(own, other, doubt)
    for k in range(count):
        put(spare, k, own, k)
        put(spare, count + k, other, k)
        put(fused, k, other if other_right[k] > 0.5 else own, k)
        box, values = fused.boxes[k], fused.values[k]
        own_reached, other_reached = compromise(own.boxes[k], other.boxes[k], other_right[k], box, room)
        own_right = (1 - other_right[k]) * own.values[k, CHANCE]
        right = other_right[k] * other.values[k, CHANCE]
        values[BEST] = max(own.values[k, BEST], other.values[k, BEST])
        values[NEAREST] = min(own.values[k, NEAREST], other.values[k, NEAREST])
        values[CHANCE] = own_right * own_reached + right * other_reached
        for row, chance in ((k, own_right), (count + k, right)):
            spare.values[row, BEST], spare.values[row, NEAREST] = values[BEST], values[NEAREST]
            spare.values[row, CHANCE] = chance * (1 - _on_object(box, spare.boxes[row], room.corners))
    return fused, spare


@njit(cache=True, nogil=True)
def _probability_other(own: FusedRows, other: FusedRows, doubt: Floats) -> Floats:
    """Return the probability (N,) that the other box of each pair is right."""
    bottom, other_bottom = own.boxes[:, 2] - own.boxes[:, 5] / 2, other.boxes[:, 2] - other.boxes[:, 5] / 2
    features = pair_features(
        column(own, SCORE), column(other, SCORE), column(own, AWAY), column(other, AWAY), other_bottom - bottom
    )
    return probability_other(doubt, features)


@njit(cache=True, nogil=True, error_model="numpy")
def _on_object(box: Floats, right: Floats, room: Floats) -> float:
    """Return the probability that a box overlaps the object enough where another is right, by their 3D IoU."""
    overlap = iou_3d_of_pair(footprint(box), footprint(right), right[2] - box[2], box[5], right[5], room)
    power = overlap**_STEEPNESS
    probability: float = power / (power + _EVEN_ODDS_IOU**_STEEPNESS)
    return probability


@njit(cache=True, nogil=True)
def _keep(replaced: FusedRows, count: int, spare: FusedRows, least_chance: float) -> int:
    """Append the boxes that are likely enough to the `count` replaced ones; return how many there are now."""
    for k in range(len(spare.label)):
        if spare.values[k, CHANCE] >= least_chance:
            put(replaced, count, spare, k)
            count += 1
    return count
