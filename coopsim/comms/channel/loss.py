"""Whether a message is lost, wherever sender and receiver are; what distance does is in
`coopsim.comms.radio.radio_config`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.support.checks import require_between, require_probability


class Loss(ABC):
    """A process of losses on one link; it keeps nothing itself, so that one object serves all links."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Whether the next message is lost, and whether the link is in a burst of losses.

        Args:
            rng: the link's stream.
            burst: whether it was in one at the message before; None: there was none.
        """


@dataclass(frozen=True, slots=True)
class BernoulliLoss(Loss):
    """Each message on each link is lost independently.

    Attributes:
        probability: in [0, 1].
    """

    probability: float = 0.0

    def __post_init__(self) -> None:
        require_probability(probability=self.probability)

    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Takes one uniform from `rng`, whatever the probability."""
        return bool(rng.random() < self.probability), False


@dataclass(frozen=True, slots=True)
class GilbertElliottLoss(Loss):
    """Losses in bursts: a link is good or bad, and changes with each message (Gilbert 1960, Elliott 1963).

    The share of bad messages is `begin / (begin + end)`, and a burst lasts `1 / end` messages on average.

    Attributes:
        begin: probability that a good link is bad at the next message, in [0, 1].
        end: probability that a bad link is good at the next message, in (0, 1].
        loss_bad: probability that a message is lost on a bad link; 1 as Gilbert has it.
        loss_good: the same on a good link.
    """

    begin: float
    end: float
    loss_bad: float = 1.0
    loss_good: float = 0.0

    def __post_init__(self) -> None:
        require_probability(begin=self.begin, loss_bad=self.loss_bad, loss_good=self.loss_good)
        require_between(1e-9, 1, end=self.end)

    @property
    def mean_loss(self) -> float:
        """The share of messages that are lost in the long run."""
        bad = self.begin / (self.begin + self.end)
        return bad * self.loss_bad + (1 - bad) * self.loss_good

    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Takes two uniforms from `rng`, whatever the parameters. The first message finds the link settled."""
        to_bad, to_lost = rng.random(2)
        if burst is None:
            burst = bool(to_bad < self.begin / (self.begin + self.end))
        else:
            burst = bool(to_bad < (1 - self.end if burst else self.begin))
        return bool(to_lost < (self.loss_bad if burst else self.loss_good)), burst


LOSSES: Mapping[str, type[Loss]] = {"bernoulli": BernoulliLoss, "gilbert_elliott": GilbertElliottLoss}
"""Losses by the names that files have for them."""
