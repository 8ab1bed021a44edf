"""Whether a message is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.checks import require_probability


@dataclass(frozen=True, slots=True)
class BernoulliLoss:
    """Each message on each link is lost independently.

    Attributes:
        probability: in [0, 1].
    """

    probability: float = 0.0

    def __post_init__(self) -> None:
        require_probability(loss=self.probability)

    def draw(self, rng: np.random.Generator) -> bool:
        """Whether one message is lost. Takes one uniform from `rng`, whatever the probability."""
        return bool(rng.random() < self.probability)
