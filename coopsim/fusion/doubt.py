"""The probability that, of two agents' boxes on one object, the other one's is right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit


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

    @property
    def weights(self) -> Floats:
        """(7,): the bias, and the weights of `pair_features` in their order."""
        scores, away = (self.own_score, self.other_score), (self.own_away, self.other_away)
        return np.array([self.bias, *scores, *away, self.gap, self.gap_away], dtype=np.float64)

    def probability_other(self, features: Floats) -> Floats:
        """Return the probability (N,) that the other box is right; `features` (N, 6) as from `pair_features`."""
        probability: Floats = probability_other(self.weights, features)
        return probability


@njit(cache=True, nogil=True)
def pair_features(
    own_score: Floats, other_score: Floats, own_away_m: Floats, other_away_m: Floats, gap_m: Floats
) -> Floats:
    """Return the features (N, 6) of `Doubt`, in the order of its weights after the bias; all arguments are (N,)."""
    features = np.empty((len(gap_m), 6))
    for k in range(len(gap_m)):
        features[k, 0], features[k, 1] = own_score[k], other_score[k]
        features[k, 2], features[k, 3] = own_away_m[k], other_away_m[k]
        features[k, 4] = abs(gap_m[k])
        features[k, 5] = features[k, 4] * own_away_m[k]
    return features


@njit(cache=True, nogil=True, error_model="numpy")
def probability_other(weights: Floats, features: Floats) -> Floats:
    """Return the probability (N,) that the other box is right, with `Doubt.weights` (7,)."""
    probability = np.empty(len(features))
    for k in range(len(features)):
        odds = 0.0
        for feature, weight in zip(features[k], weights[1:]):  # noqa: B905  (numba has no strict)
            odds += feature * weight
        probability[k] = 1 / (1 + np.exp(-(weights[0] + odds)))
    return probability
