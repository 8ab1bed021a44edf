"""Fusion of boxes by how likely each agent is right about an object that several see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from coopsim.fusion.compromise import compromise
from coopsim.fusion.registration import register
from coopsim.geometry.assignment import match_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_probability
from coopsim.types import Detections, Ints, Mask
from coopsim.types.valid_detections import drop_invalid

_CLEARNESS_POWER = 4
"""Power of the score in the weights of clearly seen boxes: one box at 0.8 counts for 16 at 0.4."""


_EVEN_ODDS_IOU, _STEEPNESS = 0.255, 6.4
"""Log odds that a box is on its object, linear in the logarithm of its 3D IoU with a right box. In the training
recordings of V2V4Real boxes between two agents' were on their object in 31 % of cases at an IoU of 0.2 to 0.25, in 64 %
in the next 0.05, then in 85, 92 and 96 %."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Log odds that, of two agents' boxes on one object, the sender's is right and the receiver's is not.

    A detector's height is good where it sees the road; far away it guesses a flat world, and another agent's boxes come
    through a relative pose whose tilt lifts or sinks those far from the sender. So the log odds are linear in the
    scores, in the distance of each box from the middle of its agent's clear area (the mean centre of its boxes,
    weighted by score^4, which needs no pose), and in the difference of their heights.

    The weights are those of a logistic regression on the training recordings 0001 to 0031 of V2V4Real: all pairs of
    boxes of which one has a 3D IoU of at least 0.25 with a label and the other has not (`scripts/fit_coop_fuse.py`).

    Attributes:
        bias: log odds with everything else 0.
        own_score: per unit of score.
        other_score: per unit of score.
        own_away: per metre from the middle of the agent's clear area.
        other_away: per metre.
        gap: per metre between the boxes' bottoms.
        gap_away: per metre between the bottoms, times metres of `own_away`.
    """

    bias: float
    own_score: float
    other_score: float
    own_away: float
    other_away: float
    gap: float
    gap_away: float

    def probability_other(self, features: Floats) -> Floats:
        """Return the probability (N,) that the other box is right; `features` (N, 6) as from `pair_features`."""
        weights = [self.own_score, self.other_score, self.own_away, self.other_away, self.gap, self.gap_away]
        probability: Floats = expit(self.bias + features @ np.array(weights))
        return probability


def pair_features(
    own_score: Floats, other_score: Floats, own_away_m: Floats, other_away_m: Floats, gap_m: Floats
) -> Floats:
    """Return the features (N, 6) of `Doubt`, in the order of its weights after the bias; all arguments are (N,)."""
    gap_m = np.abs(gap_m)
    return np.stack([own_score, other_score, own_away_m, other_away_m, gap_m, gap_m * own_away_m], axis=1)


def clear_middle(detections: Detections) -> Floats:
    """Return the middle (2,) m over ground of an agent's clear area; the origin without detections."""
    if not len(detections):
        return np.zeros(2)
    score = np.maximum(detections.score, 1e-6)
    weight = (score / score.max()) ** _CLEARNESS_POWER
    middle: Floats = weight @ detections.boxes.center[:, :2] / weight.sum()
    return middle


def away_from_middle(detections: Detections) -> Floats:
    """Return the distances (N,) m over ground from the middle of an agent's clear area."""
    return _away(detections.boxes, clear_middle(detections))


def _away(boxes: Boxes3D, middle: Floats) -> Floats:
    distance: Floats = np.linalg.norm(boxes.center[:, :2] - middle, axis=1)
    return distance


@dataclass(frozen=True, slots=True, eq=False)
class FusedBoxes:
    """K fused boxes of several agents, and features that tell how likely each is on an object.

    Attributes:
        detections: the boxes, each with the best score of all agents that see it.
        chance: (K,) probability that the box is on the object if one of the agents is right about it; 1 if only one
            agent sees it and nothing points to another place.
        nearest_m: (K,) m over ground from the middle of the clear area of the nearest agent that detects it.
        score: (K,) score of the likeliest agent.
        away_m: (K,) m over ground from the middle of that agent's clear area.
    """

    detections: Detections
    chance: Floats
    nearest_m: Floats
    score: Floats
    away_m: Floats

    @classmethod
    def of_agent(cls, detections: Detections) -> FusedBoxes:
        """Return the boxes of one agent."""
        away_m = away_from_middle(detections)
        return cls(detections, np.ones(len(detections)), away_m, detections.score, away_m)

    def __getitem__(self, rows: Ints | Mask) -> FusedBoxes:
        return FusedBoxes(
            self.detections[rows], self.chance[rows], self.nearest_m[rows], self.score[rows], self.away_m[rows]
        )

    def join(self, other: FusedBoxes) -> FusedBoxes:
        """Return these boxes followed by the others."""
        columns = ("chance", "nearest_m", "score", "away_m")
        joined = [np.concatenate([getattr(self, each), getattr(other, each)]) for each in columns]
        return FusedBoxes(Detections.concatenate([self.detections, other.detections]), *joined)


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
    registration = register(own.detections, other.detections)
    placed = registration.place(other.detections.boxes)
    own_rows, other_rows = match_boxes(own.detections.boxes, own.detections.label, placed, other.detections.label, gate)
    new = np.setdiff1d(np.arange(len(other.detections)), other_rows)
    if not registration.common:
        return Correspondence(own_rows, other_rows, new, None)
    boxes, alone = placed[new], other[new]
    # No agent detected them there: the score is 0, and only the distance is from the receiver's clear area.
    away_m = _away(boxes, clear_middle(own.detections))
    expected = replace(
        alone, detections=replace(alone.detections, boxes=boxes), away_m=away_m, score=np.zeros(len(new))
    )
    return Correspondence(own_rows, other_rows, new, expected)


def trust_likelier(
    groups: Sequence[Detections], gate: float, doubt: Doubt, hearsay: Doubt | None = None, least_chance: float = 1.0
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
    fused, replaced = FusedBoxes.of_agent(Detections.empty()), FusedBoxes.of_agent(Detections.empty())
    for group in (FusedBoxes.of_agent(drop_invalid(each)) for each in groups):
        pairs = correspond(fused, group, gate)
        agreed, spare = _fuse(fused[pairs.own], group[pairs.other], doubt)
        new = group[pairs.new]
        if hearsay is not None and pairs.expected is not None:
            new, other_spare = _fuse(pairs.expected, new, hearsay)
            spare = spare.join(other_spare)
        replaced = replaced.join(spare[spare.chance >= least_chance])
        alone = np.setdiff1d(np.arange(len(fused.detections)), pairs.own)
        order = np.argsort(np.concatenate([pairs.own, alone]), kind="stable")
        fused = agreed.join(fused[alone])[order].join(new)
    return fused.join(replaced)


def _fuse(own: FusedBoxes, other: FusedBoxes, doubt: Doubt) -> tuple[FusedBoxes, FusedBoxes]:
    """Fuse N pairs of boxes.

    Returns:
        The fused boxes (N,), and the pairs' originals (2 N,), all own ones first, each with the probability that it is
        right where the fused box is not as its chance.
    """
    gap_m = other.detections.boxes.bottom - own.detections.boxes.bottom
    other_right = doubt.probability_other(pair_features(own.score, other.score, own.away_m, other.away_m, gap_m))
    boxes, reaches = compromise(own.detections.boxes, other.detections.boxes, other_right)
    best = np.maximum(own.detections.score, other.detections.score)
    nearest_m = np.minimum(own.nearest_m, other.nearest_m)
    right = np.stack([(1 - other_right) * own.chance, other_right * other.chance])
    overlaps = np.stack([np.diag(iou_3d(boxes.array, each.detections.boxes.array)) for each in (own, other)])
    originals = own.join(other)
    spare = replace(
        originals,
        detections=replace(originals.detections, score=np.tile(best, 2)),
        chance=(right * (1 - _probability_on_object(overlaps))).ravel(),
        nearest_m=np.tile(nearest_m, 2),
    )
    count = len(other_right)
    likelier = spare[np.arange(count) + count * (other_right > 0.5)]
    fused = replace(likelier.detections, boxes=boxes)
    return replace(likelier, detections=fused, chance=(right * reaches).sum(axis=0)), spare


def _probability_on_object(overlap: Floats) -> Floats:
    """Return the probability that a box with this 3D IoU (...) with a right one overlaps the object enough too."""
    power = overlap**_STEEPNESS
    probability: Floats = power / (power + _EVEN_ODDS_IOU**_STEEPNESS)
    return probability
