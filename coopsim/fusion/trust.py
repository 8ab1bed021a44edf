"""Fusion of boxes by how likely each agent is right about an object that several see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.fusion.believed import AWAY, BEST, CHANCE, NEAREST, SCORE, Believed, of_agent
from coopsim.fusion.doubt import Doubt
from coopsim.fusion.fuse_groups import correspond_rows, fuse_groups
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_probability
from coopsim.types import Detections, Ints, Mask
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import drop_invalid


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
        return cls.of_rows(of_agent(detections.boxes.array, detections.score, detections.label, 0), detections)

    @classmethod
    def of_rows(cls, rows: Believed, source: Detections) -> FusedBoxes:
        """Return fused boxes from those of kernels; `source` has the covariances and embeddings that they carry."""
        best, chance, nearest_m, score, away_m = (rows.values[:, each] for each in (BEST, CHANCE, NEAREST, SCORE, AWAY))
        covariance = None if source.covariance is None else source.covariance[rows.origin]
        embedding = None if source.embedding is None else source.embedding[rows.origin]
        detections = Detections(Boxes3D.from_array(rows.boxes), best, rows.label, covariance, embedding)
        return cls(detections, chance, nearest_m, score, away_m)

    @property
    def rows(self) -> Believed:
        """The boxes as kernels have them, which carry their own covariances and embeddings."""
        found = self.detections
        values = np.stack([found.score, self.chance, self.nearest_m, self.score, self.away_m], axis=1)
        return Believed(found.boxes.array, values, found.label, np.arange(len(found)))

    def __getitem__(self, rows: Ints | Mask) -> FusedBoxes:
        return FusedBoxes(
            self.detections[rows], self.chance[rows], self.nearest_m[rows], self.score[rows], self.away_m[rows]
        )


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
