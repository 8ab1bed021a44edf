"""Models of loss, whatever the distance; losses by distance are in `coopsim.comms.radio.radio_config`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.support.checks import require_between, require_probability


class Loss(ABC):
    """Process of losses on a link, without state: one object serves all links."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Return flags of the next message's loss and of a burst of losses on the link, drawn from the link's stream.

        `burst` is the flag at the previous message; None: this is the first.
        """


@dataclass(frozen=True, slots=True)
class BernoulliLoss(Loss):
    """Independent losses of each message on each link.

    Attributes:
        probability: share of lost messages, in [0, 1].
    """

    probability: float = 0.0

    def __post_init__(self) -> None:
        require_probability(probability=self.probability)

    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Draw one uniform from `rng`, whatever the probability."""
        return bool(rng.random() < self.probability), False


def certain_loss(loss: Loss) -> bool | None:
    """Return whether a model loses every message (True) or none (False); None if its draws matter."""
    if type(loss) is BernoulliLoss and loss.probability in (0.0, 1.0):  # a subclass may have another rule
        return loss.probability == 1.0
    return None


@dataclass(frozen=True, slots=True)
class GilbertElliottLoss(Loss):
    """Losses in bursts: a link is good or bad, and may change with each message (Gilbert 1960, Elliott 1963).

    The share of bad messages is `begin / (begin + end)`, and a burst lasts `1 / end` messages on average.

    Attributes:
        begin: probability that a good link is bad at the next message, in [0, 1].
        end: probability that a bad link is good at the next message, in (0, 1].
        loss_bad: probability that a message is lost on a bad link; 1 in Gilbert's model.
        loss_good: probability that a message is lost on a good link.
    """

    begin: float
    end: float
    loss_bad: float = 1.0
    loss_good: float = 0.0

    def __post_init__(self) -> None:
        require_probability(begin=self.begin, loss_bad=self.loss_bad, loss_good=self.loss_good)
        require_between(1e-9, 1, end=self.end)

    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        """Draw two uniforms from `rng`, whatever the parameters. The first state is drawn from the stationary one."""
        to_bad, to_lost = rng.random(2)
        if burst is None:
            burst = bool(to_bad < self.begin / (self.begin + self.end))
        else:
            burst = bool(to_bad < (1 - self.end if burst else self.begin))
        return bool(to_lost < (self.loss_bad if burst else self.loss_good)), burst


LOSSES: Mapping[str, type[Loss]] = {"bernoulli": BernoulliLoss, "gilbert_elliott": GilbertElliottLoss}
"""Losses by the names that files have for them."""
