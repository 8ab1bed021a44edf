"""Fused boxes of several agents, and two logistic models learned from labels: which agent is right, and which box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Detections, Ints, Mask

BOX = 7
BEST, CHANCE, NEAREST, SCORE, AWAY, LABEL, ORIGIN = range(BOX, BOX + 7)
"""Columns of fused boxes in kernels, rows (N, 14) of floats: before `BOX` the seven of the box, then the best score of
all agents that see it, the further numbers of `FusedBoxes`, the class, and the row of the detection whose covariance
and embedding the box carries."""

_CLEARNESS_POWER = 4
"""Power of the score in the weights of clearly seen boxes: one box at 0.8 counts for 16 at 0.4."""


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
    def of_rows(cls, rows: Floats, source: Detections) -> FusedBoxes:
        """Return fused boxes from the rows of kernels; `source` has their covariances and embeddings."""
        label, origin = rows[:, LABEL].astype(np.int64), rows[:, ORIGIN].astype(np.int64)
        covariance = None if source.covariance is None else source.covariance[origin]
        embedding = None if source.embedding is None else source.embedding[origin]
        boxes = Boxes3D.from_array(rows[:, :BOX])
        return cls(
            Detections(boxes, rows[:, BEST], label, covariance, embedding), *rows[:, [CHANCE, NEAREST, SCORE, AWAY]].T
        )

    def __getitem__(self, rows: Ints | Mask) -> FusedBoxes:
        numbers = (self.chance, self.nearest_m, self.score, self.away_m)
        return FusedBoxes(self.detections[rows], *(each[rows] for each in numbers))


@njit(cache=True, nogil=True)
def rows_of_agent(boxes: Floats, score: Floats, label: Ints, first: int) -> Floats:
    """Return the rows (N, 14) of one agent's boxes (N, 7); `first` is the number of the first one among all agents'."""
    rows, away_m = np.ones((len(boxes), ORIGIN + 1)), away_from(boxes, clear_middle(boxes, score))
    rows[:, :BOX], rows[:, BEST], rows[:, SCORE] = boxes, score, score
    rows[:, NEAREST], rows[:, AWAY] = away_m, away_m
    rows[:, LABEL], rows[:, ORIGIN] = label, np.arange(first, first + len(boxes))
    return rows


@njit(cache=True, nogil=True, error_model="numpy")
def clear_middle(boxes: Floats, score: Floats) -> Floats:
    """Return the middle (2,) m over ground of an agent's clear area; the origin without boxes (N, 7)."""
    best, middle, total = 1e-6, np.zeros(2), 0.0
    for value in score:
        best = max(best, value)
    for k in range(len(boxes)):
        weight = (max(score[k], 1e-6) / best) ** _CLEARNESS_POWER
        middle[0] += weight * boxes[k, 0]
        middle[1] += weight * boxes[k, 1]
        total += weight
    return middle / total if len(boxes) else middle


@njit(cache=True, nogil=True)
def away_from(boxes: Floats, middle: Floats) -> Floats:
    """Return the distances (N,) m over ground of boxes (N, 7) from a place (2,)."""
    away_m = np.empty(len(boxes))
    for k in range(len(boxes)):
        x, y = boxes[k, 0] - middle[0], boxes[k, 1] - middle[1]
        away_m[k] = np.sqrt(x * x + y * y)
    return away_m


@dataclass(frozen=True, slots=True)
class SourceOdds:
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

    @property
    def weights(self) -> Floats:
        """(7,): the bias, and the weights of `pair_features` in their order."""
        scores, away = (self.own_score, self.other_score), (self.own_away, self.other_away)
        return np.array([self.bias, *scores, *away, self.gap, self.gap_away], dtype=np.float64)


@njit(cache=True, nogil=True)
def pair_features(
    own_score: Floats, other_score: Floats, own_away_m: Floats, other_away_m: Floats, gap_m: Floats
) -> Floats:
    """Return the features (N, 6) of `SourceOdds`, in the order of its weights after the bias, of pairs (N,)."""
    features = np.empty((len(gap_m), 6))
    for k in range(len(gap_m)):
        features[k, 0], features[k, 1] = own_score[k], other_score[k]
        features[k, 2], features[k, 3] = own_away_m[k], other_away_m[k]
        features[k, 4] = abs(gap_m[k])
        features[k, 5] = features[k, 4] * own_away_m[k]
    return features


@njit(cache=True, nogil=True, error_model="numpy")
def probability_other(weights: Floats, features: Floats) -> Floats:
    """Return the probability (N,) that the other box is right, with `SourceOdds.weights` (7,)."""
    probability = np.empty(len(features))
    for k in range(len(features)):
        odds = 0.0
        for feature, weight in zip(features[k], weights[1:]):  # noqa: B905  (numba has no strict)
            odds += feature * weight
        probability[k] = 1 / (1 + np.exp(-(weights[0] + odds)))
    return probability


@dataclass(frozen=True, slots=True)
class Calibration:
    """Probability that a box is on an object, by its score, distance, volume and the agents' agreement (Platt 1999).

    A score rates how much some points look like an object, not whether the box around them overlaps it. Of two boxes
    with the same score, one far from the clear area misses more often, most of all in height, and a larger one
    overlaps more often: the same error is a smaller part of it. The log odds are linear in these. Where agents differ,
    at most one of them is right, so the result is multiplied by a power of `FusedBoxes.chance`.

    Attributes:
        bias: log odds with everything else 0.
        score: per unit of score.
        away: per metre from the middle of the clear area of the nearest agent that detects it, see `SourceOdds`.
        volume: per unit of the logarithm of its volume in m^3.
        chance: power of the chance; below 1 where small chances come true more often than their value.
    """

    bias: float
    score: float
    away: float
    volume: float
    chance: float

    def of(self, boxes: FusedBoxes) -> Floats:
        """Return the probability (N,) of being on an object."""
        weights = np.array([self.score, self.away, self.volume])
        probability: Floats = boxes.chance**self.chance * expit(self.bias + self.features(boxes) @ weights)
        return probability

    @staticmethod
    def features(boxes: FusedBoxes) -> Floats:
        """Return the features (N, 3) of the weights after the bias, of boxes with sizes > 0."""
        volume = np.log(boxes.detections.boxes.size).sum(axis=1)
        return np.stack([boxes.detections.score, boxes.nearest_m, volume], axis=1)
