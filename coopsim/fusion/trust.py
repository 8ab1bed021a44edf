"""Fusion of boxes by how likely each agent is right about an object that several see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from coopsim.fusion.box_matching import match_boxes
from coopsim.fusion.compromise import compromise
from coopsim.fusion.registration import register
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_probability
from coopsim.tracking.tracker import sane
from coopsim.types import Detections, Ints, Mask

_CLEARLY = 4
"""Power of the score in the weights of what an agent sees clearly: one box at 0.8 counts for 16 at 0.4."""


_AS_LIKELY_AS_NOT, _STEEPNESS = 0.255, 6.4
"""Of how the 3D IoU with a right box tells whether the object is overlapped enough too. In the training recordings of
V2V4Real boxes between two agents' were on their object in 31 % of cases where it was 0.2 to 0.25, in 64 % in the next
0.05, then in 85, 92 and 96 %: log odds linear in its logarithm."""


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


def clear_middle(detections: Detections) -> Floats:
    """The middle (2,) m over ground of what an agent sees clearly; the origin if it sees nothing."""
    if not len(detections):
        return np.zeros(2)
    score = np.maximum(detections.score, 1e-6)
    weight = (score / score.max()) ** _CLEARLY
    middle: Floats = weight @ detections.boxes.center[:, :2] / weight.sum()
    return middle


def away_from_middle(detections: Detections) -> Floats:
    """Distance (N,) m over ground from the middle of what an agent sees clearly."""
    return _away(detections.boxes, clear_middle(detections))


def _away(boxes: Boxes3D, middle: Floats) -> Floats:
    distance: Floats = np.linalg.norm(boxes.center[:, :2] - middle, axis=1)
    return distance


@dataclass(frozen=True, slots=True, eq=False)
class Believed:
    """K boxes that agents see, fused, and what tells how likely each is on an object.

    Attributes:
        found: the boxes, each with the best score of all agents that see it.
        chance: (K,) that it is on the object if one of the agents is right about it; 1 if only one sees it and nothing
            tells of another place.
        nearest_m: (K,) m over ground from the middle of what the nearest agent that sees it sees clearly.
        score: (K,) of the likeliest agent.
        away_m: (K,) m over ground from the middle of what that agent sees clearly.
    """

    found: Detections
    chance: Floats
    nearest_m: Floats
    score: Floats
    away_m: Floats

    @classmethod
    def of_one(cls, found: Detections) -> Believed:
        """What one agent sees."""
        away_m = away_from_middle(found)
        return cls(found, np.ones(len(found)), away_m, found.score, away_m)

    def __getitem__(self, rows: Ints | Mask) -> Believed:
        return Believed(self.found[rows], self.chance[rows], self.nearest_m[rows], self.score[rows], self.away_m[rows])

    def join(self, other: Believed) -> Believed:
        """These and then the others."""
        columns = ("chance", "nearest_m", "score", "away_m")
        joined = [np.concatenate([getattr(self, each), getattr(other, each)]) for each in columns]
        return Believed(Detections.concatenate([self.found, other.found]), *joined)


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """What two agents say of the same objects.

    Attributes:
        mine: (K,) rows of the own boxes that the other sees too.
        theirs: (K,) the other's rows.
        new: (L,) the other's rows of what only it sees.
        expected: (L,) where those would lie, by registration, had the receiver's own sensor seen them; None where
            nothing is common, and nothing to register by.
    """

    mine: Ints
    theirs: Ints
    new: Ints
    expected: Believed | None


def compare(own: Believed, other: Believed, gate: float) -> Compared:
    """Match what two agents see under their registration, in which a common error of a pose or a clock has no part."""
    found = register(own.found, other.found)
    placed = found.place(other.found.boxes)
    mine, theirs = match_boxes(own.found.boxes, own.found.label, placed, other.found.label, gate)
    new = np.setdiff1d(np.arange(len(other.found)), theirs)
    if not found.common:
        return Compared(mine, theirs, new, None)
    boxes, alone = placed[new], other[new]
    # Nobody saw them there: no score, and only the distance from what the receiver sees is its own.
    away_m = _away(boxes, clear_middle(own.found))
    expected = replace(alone, found=replace(alone.found, boxes=boxes), away_m=away_m, score=np.zeros(len(new)))
    return Compared(mine, theirs, new, expected)


def trust_likelier(
    groups: Sequence[Detections], gate: float, doubt: Doubt, hearsay: Doubt | None = None, least_chance: float = 1.0
) -> Believed:
    """One box per object: between the agents' boxes, where it is most likely right.

    Each group is matched to what the groups before left (Hungarian on the BEV GIoU, per class, after registration), and
    what is new is added. A fused box has the heading, covariance and embedding of the likelier one, the best score of
    all, and lies where it most likely overlaps the object (`compromise`). Where it may miss the object although one of
    the two is right, that one may be kept as a box of its own, last of all, with what chance is left to it.

    What the receiver does not see itself is treated alike: it may lie where the other agent says, or where registration
    says that the receiver would see it.

    Args:
        groups: one per agent, in one frame, the receiver's own first. Boxes that are not finite or have no size are
            left out.
        gate: smallest BEV GIoU of boxes on one object, in [-1, 1].
        doubt: what makes a box doubtful.
        hearsay: what makes doubtful what only another agent sees; None: it is believed.
        least_chance: how likely a box that was given up must be right where the fused one is not, in [0, 1], to be
            kept; 1: none is.
    """
    require_between(-1, 1, gate=gate)
    require_probability(least_chance=least_chance)
    fused, given_up = Believed.of_one(Detections.empty()), Believed.of_one(Detections.empty())
    for group in (Believed.of_one(sane(each)) for each in groups):
        seen = compare(fused, group, gate)
        agreed, spare = _fuse(fused[seen.mine], group[seen.theirs], doubt)
        new = group[seen.new]
        if hearsay is not None and seen.expected is not None:
            new, other_spare = _fuse(seen.expected, new, hearsay)
            spare = spare.join(other_spare)
        given_up = given_up.join(spare[spare.chance >= least_chance])
        alone = np.setdiff1d(np.arange(len(fused.found)), seen.mine)
        order = np.argsort(np.concatenate([seen.mine, alone]), kind="stable")
        fused = agreed.join(fused[alone])[order].join(new)
    return fused.join(given_up)


def _fuse(own: Believed, other: Believed, doubt: Doubt) -> tuple[Believed, Believed]:
    """Fused boxes of N pairs; and the pairs' own boxes, and their other ones, as far as the fused miss the object."""
    gap_m = other.found.boxes.bottom - own.found.boxes.bottom
    share = doubt.of_own(pair_features(own.score, other.score, own.away_m, other.away_m, gap_m))
    boxes, reaches = compromise(own.found.boxes, other.found.boxes, share)
    best, nearest_m = np.maximum(own.found.score, other.found.score), np.minimum(own.nearest_m, other.nearest_m)
    right = np.stack([(1 - share) * own.chance, share * other.chance])
    overlaps = np.stack([np.diag(iou_3d(boxes.array, each.found.boxes.array)) for each in (own, other)])
    pairs = own.join(other)  # all own ones, then all others
    spare = replace(
        pairs,
        found=replace(pairs.found, score=np.tile(best, 2)),
        chance=(right * (1 - _suffices(overlaps))).ravel(),
        nearest_m=np.tile(nearest_m, 2),
    )
    likelier = spare[np.arange(len(share)) + len(share) * (share > 0.5)]
    return replace(likelier, found=replace(likelier.found, boxes=boxes), chance=(right * reaches).sum(axis=0)), spare


def _suffices(overlap: Floats) -> Floats:
    """How likely a box that overlaps a right one so much, 3D IoU (...), overlaps the object enough as well."""
    risen = overlap**_STEEPNESS
    likely: Floats = risen / (risen + _AS_LIKELY_AS_NOT**_STEEPNESS)
    return likely
