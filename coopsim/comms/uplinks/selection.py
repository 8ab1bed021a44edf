"""The order in which objects are sent when not all fit: by how much they help the receivers.

In the spirit of Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial
Confidence Maps", NeurIPS 2022): send where the sender is confident and the receivers are in need. There both are maps
of features; here the confidence is an object's score, and the need is estimated from where receivers are and what they
sent last.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.envelope import decode_detections
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.support.registry import Registry
from coopsim.types import NS_PER_S, Detections, Ints, Mask, Message, Observation

_SIGHT_M = 40.0
"""At this distance another agent has an object in sight with an assumed probability of 1 / e."""

_SAME_M = 2.5
"""Objects closer than this are taken for the same."""

_REPORTED = 0.1
"""Factor on the utility of an object that another agent has just reported with a higher score."""

_KEPT = 3.0
"""Factor on the utility of an object of the agent's last message: trackers need repeated detections."""

_VALID_NS = NS_PER_S // 2


class Selection(ABC):
    """A ranking of one agent's detections over one episode; asked at most once per frame, in order.

    Args:
        rng: the agent's random stream for this purpose.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    @abstractmethod
    def utility(self, sender: str, observation: Observation) -> Floats:
        """Return the utility (N,) of the agent's detections; larger is sent first."""

    def hear(self, observation: Observation, decoded: DecodeOnce) -> None:
        """Take notice of the messages in the observation's inbox."""

    def sent(self, message: Message, decoded: DecodeOnce) -> None:
        """Take notice of the agent's own message of this frame."""

    def order(self, sender: str, observation: Observation) -> Ints:
        """Return the rows (N,) of the detections, the most useful first."""
        return np.argsort(-self.utility(sender, observation), kind="stable")


class AtRandom(Selection):
    """Random order: shows what dropping objects costs, to compare others with."""

    def utility(self, sender: str, observation: Observation) -> Floats:
        return self._rng.random(len(observation.detections))


class ByScore(Selection):
    """The highest scores first."""

    def utility(self, sender: str, observation: Observation) -> Floats:
        return observation.detections.score


@dataclass(frozen=True, slots=True, eq=False)
class _Report:
    """The last message of one agent, in the world frame."""

    captured_ns: int
    place: Floats
    position: Floats
    score: Floats

    def same_objects(self, position: Floats) -> Mask:
        """Return the mask (N, M) of positions (N, 2) and reported objects that are the same object, by distance."""
        same: Mask = np.hypot(*(position[:, None] - self.position).transpose(2, 0, 1)) < _SAME_M
        return same


class ByNeed(Selection):
    """High scores first, of objects that the other agents are unlikely to know.

    The utility is the score, times the probability that no other agent has the object in sight (with the distance d to
    each it is 1 - exp(-(d / 40 m)^2)), times 0.1 if another agent's last message had it with a higher score: of two
    agents that see an object, the one with the higher score goes on reporting it. Times 3 if the agent's own last
    message had it: trackers need repeated detections. Positions are compared in the world frame, by estimated poses.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self._reports: dict[str, _Report] = {}
        self._own: _Report | None = None

    def sent(self, message: Message, decoded: DecodeOnce) -> None:
        self._own = _report(message, decoded)

    def hear(self, observation: Observation, decoded: DecodeOnce) -> None:
        for message in observation.inbox:
            known = self._reports.get(message.sender)
            if known is None or message.captured_ns > known.captured_ns:
                self._reports[message.sender] = _report(message, decoded)
        oldest_ns = observation.time_ns - _VALID_NS
        self._reports = {name: each for name, each in self._reports.items() if each.captured_ns >= oldest_ns}

    def utility(self, sender: str, observation: Observation) -> Floats:
        found = observation.detections
        position = found.boxes.transform(observation.pose.world_SE3_base).center[:, :2]
        useful = found.score.copy()
        for name, report in self._reports.items():
            useful *= -np.expm1(-np.square(np.hypot(*(position - report.place).T) / _SIGHT_M))
            surer = (report.score > found.score[:, None]) | ((report.score == found.score[:, None]) & (name < sender))
            useful[(report.same_objects(position) & surer).any(axis=1)] *= _REPORTED
        if self._own is not None:
            useful[self._own.same_objects(position).any(axis=1)] *= _KEPT
        return useful


def _report(message: Message, decoded: DecodeOnce) -> _Report:
    place = message.pose.world_SE3_base
    try:
        found = decoded(message, decode_detections)
    except CodecError:  # counted by the policy that receives it; here it says no more than where its sender is
        found = Detections.empty()
    position = found.boxes.transform(place).center[:, :2]
    return _Report(message.captured_ns, place.translation[:2], position, found.score)


SELECTIONS: Registry[Callable[[np.random.Generator], Selection]] = Registry("selection")
SELECTIONS.register("need")(ByNeed)
SELECTIONS.register("score")(ByScore)
SELECTIONS.register("random")(AtRandom)
