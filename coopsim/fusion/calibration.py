"""From a detector's scores to probabilities (J. Platt, "Probabilistic Outputs for Support Vector Machines", 1999)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from coopsim.fusion.trust import Believed
from coopsim.geometry.se3 import Floats


@dataclass(frozen=True, slots=True)
class Calibration:
    """How likely a box is on an object: by its score, how far off it is, how large, and how undisputed.

    A score says how much some points look like an object, not whether the box around them overlaps it. Of two boxes
    with the same score the one far from what is seen clearly is the likelier to miss, most of all in height, and the
    larger one is the likelier to overlap: the same error is less of it. The log odds are linear in these. Where agents
    differ, one of them at most is right, so what comes out is multiplied by a power of `Believed.chance`.

    Attributes:
        bias: log odds with everything else 0.
        score: per unit of score.
        away: per metre from the middle of what the nearest agent that sees it sees clearly.
        volume: per unit of the logarithm of its volume in m^3.
        chance: power of the chance; below 1 where small chances come true more often than they say.
    """

    bias: float
    score: float
    away: float
    volume: float
    chance: float

    def of(self, believed: Believed) -> Floats:
        """Probability (N,) of being on an object."""
        weights = np.array([self.score, self.away, self.volume])
        probability: Floats = believed.chance**self.chance * expit(self.bias + self.features(believed) @ weights)
        return probability

    @staticmethod
    def features(believed: Believed) -> Floats:
        """What the weights after the bias are for, (N, 3), of boxes with sizes > 0."""
        volume = np.log(believed.found.boxes.size).sum(axis=1)
        return np.stack([believed.found.score, believed.nearest_m, volume], axis=1)
