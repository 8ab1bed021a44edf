"""What to say first when not all can be said: objects in the order of how much they help others.

The spirit is Where2comm's (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial
Confidence Maps", NeurIPS 2022): send where the sender is confident and the receiver in need. There both are maps of
features; here the confidence is an object's score, and the need is told from where others are and what they said last.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coopsim.comms.envelope import decode_detections
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.support.registry import Registry
from coopsim.types import NS_PER_S, Detections, Ints, Mask, Message, Observation

_SIGHT_M = 40.0
"""At this distance an agent has an object in sight with the chance 1 / e, as far as one who is elsewhere can tell."""

_SAME_M = 2.5
_SAID = 0.1
"""What an object is worth that another agent has just reported, and more surely."""

_KEPT = 3.0
"""What an object is worth more that the agent reported in its last message: trackers need to see a thing repeatedly."""

_VALID_NS = NS_PER_S // 2


class Selection(ABC):
    """Ranks one agent's objects over one episode; asked once in each frame, in order.

    Args:
        rng: the agent's stream for this purpose.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    @abstractmethod
    def utility(self, sender: str, observation: Observation) -> Floats:
        """(N,) of the agent's own detections; larger is sent first."""

    def hear(self, observation: Observation) -> None:
        """What others said, in the observation's inbox."""

    def sent(self, message: Message) -> None:
        """What the agent itself said in this frame."""

    def order(self, sender: str, observation: Observation) -> Ints:
        """(N,) rows of the detections, the most useful first."""
        return np.argsort(-self.utility(sender, observation), kind="stable")


class AtRandom(Selection):
    """In no order: what dropping costs, to compare with."""

    def utility(self, sender: str, observation: Observation) -> Floats:
        return self._rng.random(len(observation.detections))


class ByScore(Selection):
    """The surest first."""

    def utility(self, sender: str, observation: Observation) -> Floats:
        return observation.detections.score


@dataclass(frozen=True, slots=True, eq=False)
class _Said:
    """The last message of one agent, in the world frame."""

    captured_ns: int
    place: Floats
    position: Floats
    score: Floats

    def near(self, position: Floats) -> Mask:
        """(N, M) which of positions (N, 2) and of what was said are one object, as far as positions tell."""
        apart: Mask = np.hypot(*(position[:, None] - self.position).transpose(2, 0, 1)) < _SAME_M
        return apart


class ByNeed(Selection):
    """The surest of what others are unlikely to know.

    The score, times the chance that no other agent has the object in sight (it falls with the distance d to each as
    1 - exp(-(d / 40 m)^2)), times 0.1 if another's last message had it with a higher score: of two who see an object
    the surer one goes on reporting it. Times 3 if the agent's own last message had it: trackers need to see a thing
    repeatedly. Positions are compared in the world frame, as the agents believe them to be.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self._said: dict[str, _Said] = {}
        self._own: _Said | None = None

    def sent(self, message: Message) -> None:
        self._own = _said(message)

    def hear(self, observation: Observation) -> None:
        for message in observation.inbox:
            known = self._said.get(message.sender)
            if known is None or message.captured_ns > known.captured_ns:
                self._said[message.sender] = _said(message)
        oldest_ns = observation.time_ns - _VALID_NS
        self._said = {name: said for name, said in self._said.items() if said.captured_ns >= oldest_ns}

    def utility(self, sender: str, observation: Observation) -> Floats:
        found = observation.detections
        position = found.boxes.transform(observation.pose.world_SE3_base).center[:, :2]
        useful = found.score.copy()
        for name, said in self._said.items():
            useful *= -np.expm1(-np.square(np.hypot(*(position - said.place).T) / _SIGHT_M))
            surer = (said.score > found.score[:, None]) | ((said.score == found.score[:, None]) & (name < sender))
            useful[(said.near(position) & surer).any(axis=1)] *= _SAID
        if self._own is not None:
            useful[self._own.near(position).any(axis=1)] *= _KEPT
        return useful


def _said(message: Message) -> _Said:
    place = message.pose.world_SE3_base
    try:
        found = decode_detections(message)
    except CodecError:  # a receiver counts it; here it says no more than where its sender is
        found = Detections.empty()
    position = found.boxes.transform(place).center[:, :2]
    return _Said(message.captured_ns, place.translation[:2], position, found.score)


SELECTIONS: Registry[Callable[[np.random.Generator], Selection]] = Registry("selection")
SELECTIONS.register("need")(ByNeed)
SELECTIONS.register("score")(ByScore)
SELECTIONS.register("random")(AtRandom)
