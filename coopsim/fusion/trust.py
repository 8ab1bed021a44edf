"""Fusion of boxes by how likely each agent is right about an object that several see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from coopsim.checks import require_between
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev
from coopsim.geometry.se3 import Floats
from coopsim.tracking.assignment import hungarian
from coopsim.tracking.tracker import sane
from coopsim.types import Detections

_CLEARLY = 4
"""Power of the score in the weights of what an agent sees clearly: one box at 0.8 counts for 16 at 0.4."""

_ON_OBJECT, _BLUR = 0.25, 0.03
"""3D IoU from which on a box is right, as the benchmark has it, and how softly it counts as right about there."""

_COMMON_GROUND = 0.7
"""Share of a box's footprint that the object's covers, of boxes that cover less of it than most."""

_SHARES = np.linspace(0.0, 1.0, 9)
_FLOOR, _ROOF = (_SHARES[each][:, None] for each in np.triu_indices(len(_SHARES)))
"""How far up from the lower of two boxes to the higher one a floor and a roof may be, the roof at least as far."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Log odds that, of two agents' boxes on one object, the other's is right and the own one is not, or the reverse.

    A detector's height is good where it sees the road; far away it guesses a flat world, and what comes from another
    agent comes through a relative pose whose tilt lifts or sinks what is far from its sender. So the log odds are
    linear in the scores, in how far each box is from the middle of what its agent sees clearly (the mean centre,
    weighted by score^4, which needs no pose), and in the difference of their heights above it.

    The weights are those of a logistic regression on the training recordings 0001 to 0031 of V2V4Real: all pairs of
    boxes of which one has a 3D IoU of at least 0.25 with a label and the other has not (`scripts/fit_coop_fuse.py`).

    Attributes:
        bias: with everything else 0.
        own_score: per unit of score.
        other_score: per unit of score.
        own_away: per metre from the middle of what the agent sees clearly.
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

    def of_own(self, features: Floats) -> Floats:
        """Probability (N,) that the other box is right rather than the own one; `features` as `pair_features`."""
        weights = [self.own_score, self.other_score, self.own_away, self.other_away, self.gap, self.gap_away]
        probability: Floats = expit(self.bias + features @ np.array(weights))
        return probability


def pair_features(
    own_score: Floats, other_score: Floats, own_away_m: Floats, other_away_m: Floats, gap_m: Floats
) -> Floats:
    """What `Doubt` looks at, (N, 6), in the order of its weights after the bias; all arguments are (N,)."""
    gap_m = np.abs(gap_m)
    return np.stack([own_score, other_score, own_away_m, other_away_m, gap_m, gap_m * own_away_m], axis=1)


def away_from_middle(detections: Detections) -> Floats:
    """Distance (N,) m over ground from the middle of what an agent sees clearly."""
    if not len(detections):
        return np.zeros(0)
    places = detections.boxes.center[:, :2]
    weight = np.maximum(detections.score, 1e-6) ** _CLEARLY
    distance: Floats = np.linalg.norm(places - weight @ places / weight.sum(), axis=1)
    return distance


def trust_likelier(groups: Sequence[Detections], gate: float, doubt: Doubt) -> tuple[Detections, Floats]:
    """One box per object: the mean of the agents' boxes, weighted by how likely each is the right one.

    Each group is matched to what the groups before left (Hungarian on the BEV GIoU, per class), and what is new is
    added. A fused box has the heading, covariance and embedding of the likelier one, the best score of all, and a
    floor and a roof between which it most likely overlaps the object (`_floor_and_roof`).

    Args:
        groups: one per agent, in one frame, the receiver's own first.
        gate: smallest BEV GIoU of boxes on one object, in [-1, 1].
        doubt: what makes a box doubtful.

    Returns:
        (K,) detections, and how far (K,) m each is from the middle of what the nearest of the agents that see it sees
        clearly. Boxes that are not finite or have no size are left out.
    """
    require_between(-1, 1, gate=gate)
    fused = Detections.empty()
    held, away = np.zeros(0), np.zeros(0)  # of the likelier box; `fused` has the best score of all agents
    nearest = np.zeros(0)
    for group in map(sane, groups):
        group_away = away_from_middle(group)
        affinity = giou_bev(fused.boxes.array, group.boxes.array)
        affinity[fused.label[:, None] != group.label] = -np.inf
        mine, theirs = hungarian(affinity, gate)
        own, other = fused.boxes[mine], group.boxes[theirs]
        gap_m = bottom(other) - bottom(own)
        share = doubt.of_own(pair_features(held[mine], group.score[theirs], away[mine], group_away[theirs], gap_m))
        new = np.setdiff1d(np.arange(len(group)), theirs)
        score = np.concatenate([fused.score, group.score[new]])
        score[mine] = np.maximum(score[mine], group.score[theirs])
        nearest = np.concatenate([nearest, group_away[new]])
        nearest[mine] = np.minimum(nearest[mine], group_away[theirs])
        # Whose box is the likelier: rows of the fused ones, then of the group's.
        likelier = np.concatenate([np.arange(len(fused)), len(fused) + new])
        likelier[mine] = np.where(share > 0.5, len(fused) + theirs, mine)
        held, away = np.concatenate([held, group.score])[likelier], np.concatenate([away, group_away])[likelier]
        joined = Detections.concatenate([fused, group])[likelier]
        boxes = joined.boxes.array.copy()
        boxes[mine, :6] = _between(own, other, share)
        fused = replace(joined, boxes=Boxes3D.from_array(boxes), score=score)
    return fused, nearest


def _between(own: Boxes3D, other: Boxes3D, share: Floats) -> Floats:
    """Centre and size (N, 6) between two boxes, `share` of the way from the own one to the other."""
    extent: Floats = own.array[:, :6] + share[:, None] * (other.array[:, :6] - own.array[:, :6])
    floor, roof = _floor_and_roof(own, other, share)
    extent[:, 2], extent[:, 5] = (floor + roof) / 2, roof - floor
    return extent


def _floor_and_roof(own: Boxes3D, other: Boxes3D, share: Floats) -> tuple[Floats, Floats]:
    """Heights (N,) m between which a box most likely overlaps the object enough, whichever of two boxes is right.

    Where the two differ little the mean overlaps both; where they differ more, a box in between, taller than either,
    does; where they differ by more than their own height and one is far likelier, that one is taken.
    """
    floors = np.stack([bottom(own), bottom(other)])
    roofs = floors + np.stack([own.size[:, 2], other.size[:, 2]])
    order = np.argsort(floors, axis=0, kind="stable")
    low_to_high = (np.take_along_axis(each, order, axis=0) for each in (floors, roofs, np.stack([1 - share, share])))
    floors, roofs, chances = low_to_high
    floor = floors[0] + _FLOOR * (floors[1] - floors[0])
    roof = roofs[0] + _ROOF * (roofs[1] - roofs[0])
    right = -3e-3 * ((_FLOOR - chances[1]) ** 2 + (_ROOF - chances[1]) ** 2)  # of equals the one nearest to the mean
    for its_floor, its_roof, chance in zip(floors, roofs, chances, strict=True):
        common = _COMMON_GROUND * np.maximum(np.minimum(roof, its_roof) - np.maximum(floor, its_floor), 0.0)
        overlap = common / (roof - floor + its_roof - its_floor - common)
        right = right + chance * expit((overlap - _ON_OBJECT) / _BLUR)
    best = right.argmax(axis=0), np.arange(len(share))
    return floor[best], roof[best]


def bottom(boxes: Boxes3D) -> Floats:
    """Height (N,) m of the undersides."""
    height: Floats = boxes.center[:, 2] - boxes.size[:, 2] / 2
    return height
