"""From a detector's scores to probabilities (J. Platt, "Probabilistic Outputs for Support Vector Machines", 1999)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from coopsim.geometry.se3 import Floats
from coopsim.types import Detections


@dataclass(frozen=True, slots=True)
class Calibration:
    """Log odds that a box is on an object: linear in its score, in how far off it is, and in how large.

    A score says how much some points look like an object, not whether the box around them overlaps it. Of two boxes
    with the same score the one far from what is seen clearly is the likelier to miss, most of all in height, and the
    larger one is the likelier to overlap: the same error is less of it.

    Attributes:
        bias: with everything else 0.
        score: per unit of score.
        away: per metre from the middle of what the nearest agent that sees it sees clearly.
        volume: per unit of the logarithm of its volume in m^3.
    """

    bias: float
    score: float
    away: float
    volume: float

    def of(self, detections: Detections, away_m: Floats) -> Floats:
        """Probability (N,) of being on an object; the arguments are those of `features`."""
        weights = np.array([self.score, self.away, self.volume])
        probability: Floats = expit(self.bias + self.features(detections, away_m) @ weights)
        return probability

    @staticmethod
    def features(detections: Detections, away_m: Floats) -> Floats:
        """What the weights after the bias are for, (N, 3).

        Args:
            detections: N boxes with sizes > 0 and a detector's scores.
            away_m: (N,) m over ground, as `coopsim.fusion.trust.trust_likelier` gives it.
        """
        return np.stack([detections.score, away_m, np.log(detections.boxes.size).sum(axis=1)], axis=1)
