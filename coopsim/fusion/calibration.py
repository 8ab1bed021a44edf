"""Detector scores as probabilities (J. Platt, "Probabilistic Outputs for Support Vector Machines", 1999)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from coopsim.fusion.trust import FusedBoxes
from coopsim.geometry.se3 import Floats


@dataclass(frozen=True, slots=True)
class Calibration:
    """The probability that a box is on an object: by its score, its distance, its volume and the agents' agreement.

    A score rates how much some points look like an object, not whether the box around them overlaps it. Of two boxes
    with the same score, one far from the clear area misses more often, most of all in height, and a larger one
    overlaps more often: the same error is a smaller part of it. The log odds are linear in these. Where agents differ,
    at most one of them is right, so the result is multiplied by a power of `FusedBoxes.chance`.

    Attributes:
        bias: log odds with everything else 0.
        score: per unit of score.
        away: per metre from the middle of the clear area of the nearest agent that detects it, see `Doubt`.
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
