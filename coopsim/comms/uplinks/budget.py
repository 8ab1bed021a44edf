"""Uplinks within a budget of bytes, and the order in which objects are sent when not all fit.

The order is in the spirit of Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via
Spatial Confidence Maps", NeurIPS 2022): send where the sender is confident and the receivers are in need. There both
are maps of features; here the confidence is an object's score, and the need is estimated from the receivers' places and
latest messages.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS, codecs_of
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.envelope import decode_detections, encode_message
from coopsim.comms.uplinks.uplink import ContentUplink, Silence, Uplink
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError, InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_count
from coopsim.support.registry import Registry
from coopsim.types import NS_PER_S, Detections, Ints, Mask, Message, Observation

_SIGHT_M = 40.0
"""At this distance another agent has an object in sight with an assumed probability of 1 / e."""

_SAME_M = 2.5
"""Objects closer than this are taken for the same."""

REPORTED = 0.1
"""Factor on the utility of an object that another agent has just reported with a higher score."""

KEPT = 3.0
"""Factor on the utility of an object of the agent's last message: trackers need repeated detections."""

_VALID_NS = NS_PER_S // 2


class Selection(ABC):
    """Ranking of one agent's detections over one episode; asked at most once per frame, in order."""

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
class Report:
    """The last message of one agent, in the world frame."""

    captured_ns: int
    world_SE3_base: SE3
    position: Floats
    score: Floats

    def same_objects(self, position: Floats) -> Mask:
        """Return the mask (N, M) of positions (N, 2) and reported objects that are the same object, by distance."""
        same: Mask = np.hypot(*(position[:, None] - self.position).transpose(2, 0, 1)) < _SAME_M
        return same


class Listening(Selection):
    """A ranking that knows what the others said last, and what the agent itself said."""

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.reports: dict[str, Report] = {}
        self.own: Report | None = None

    def sent(self, message: Message, decoded: DecodeOnce) -> None:
        self.own = _report(message, decoded)

    def hear(self, observation: Observation, decoded: DecodeOnce) -> None:
        for message in observation.inbox:
            known = self.reports.get(message.sender)
            if known is None or message.captured_ns > known.captured_ns:
                self.reports[message.sender] = _report(message, decoded)
        oldest_ns = observation.time_ns - _VALID_NS
        self.reports = {name: each for name, each in self.reports.items() if each.captured_ns >= oldest_ns}

    def others(self, sender: str, score: Floats, position: Floats) -> tuple[Floats, Ints]:
        """Return what the others know of the agent's objects.

        Returns:
            the share (N,) of the other agents that are expected not to have the object in sight, 1 where nobody was
            heard; and the number (N,) of the others whose last message had it with a higher score.
        """
        unseen, surer = list[Floats](), np.zeros(len(position), dtype=np.int64)
        for name, report in self.reports.items():
            away_m = np.hypot(*(position - report.world_SE3_base.translation[:2]).T)
            unseen.append(-np.expm1(-np.square(away_m / _SIGHT_M)))
            higher = (report.score > score[:, None]) | ((report.score == score[:, None]) & (name < sender))
            surer += (report.same_objects(position) & higher).any(axis=1)
        return np.mean(unseen, axis=0) if unseen else np.ones(len(position)), surer


class ByNeed(Listening):
    """High scores first, of objects that the other agents are unlikely to know.

    The utility is the score, times the share of the other agents that are expected not to have the object in sight
    (with the distance d to each, 1 - exp(-(d / 40 m)^2)), times 0.1 for each whose last message had it with a
    higher score: of two agents that see an object, the one with the higher score goes on reporting it. Times 3 if the
    agent's own last message had it: trackers need repeated detections. Positions are compared in the world frame, by
    estimated poses.

    The share is a mean over the others, not the product, the probability that nobody has it in sight. Among five agents
    the product sends what is far from all, and ranks below a random order.
    """

    def utility(self, sender: str, observation: Observation) -> Floats:
        found = observation.detections
        position = found.boxes.transform(observation.pose.world_SE3_base).center[:, :2]
        unseen, surer = self.others(sender, found.score, position)
        useful: Floats = found.score * np.power(REPORTED, surer) * unseen
        if self.own is not None:
            useful[self.own.same_objects(position).any(axis=1)] *= KEPT
        return useful


def nearest(position: Floats, others: Floats) -> Ints:
    """Return for each position (N, 2) the row of the nearest other (M, 2), -1 if none is near enough to be the same."""
    if not len(others):
        return np.full(len(position), -1)
    away_m = np.hypot(*(position[:, None] - others).transpose(2, 0, 1))
    rows: Ints = np.where(away_m.min(axis=1) < _SAME_M, away_m.argmin(axis=1), -1)
    return rows


def _report(message: Message, decoded: DecodeOnce) -> Report:
    place = message.pose.world_SE3_base
    try:
        found = decoded(message, decode_detections)
    except CodecError:  # counted by the policy that receives it; here it says no more than where its sender is
        found = Detections.empty()
    position = found.boxes.transform(place).center[:, :2]
    return Report(message.captured_ns, place, position, found.score)


SELECTIONS: Registry[Callable[..., Selection]] = Registry("selection", home="coopsim.comms.uplinks.learned_selection")
"""Rankings by name, for the option `selection`; each is made with an agent's random stream and a spec's parameters."""
SELECTIONS.register("need")(ByNeed)
SELECTIONS.register("score")(ByScore)
SELECTIONS.register("random")(AtRandom)


def make_selection(spec: object, rng: np.random.Generator) -> Selection:
    """Make a ranking by its spec, such as `need`, `in_turn` or `learned(weights=mine.safetensors)`.

    Raises:
        UnknownNameError: there is no such ranking, or no such parameter.
        InvalidValueError: the spec has another shape, or the value of a parameter is not accepted.
        MissingDependencyError: the ranking needs a package that is not installed.
    """
    name, parameters = parse_spec("selection", spec)
    return instantiate("selection", name, partial(SELECTIONS.get(name), rng), parameters)


MakeSelection = Callable[[str], Selection]
"""A new selection for an agent and an episode."""


class WithinBudget(Uplink):
    """Messages of another uplink, as much of them as fits, the most useful part first.

    Detections are ranked by a `Selection`; of other contents the codec decides what is least useful: cells and queries
    of low confidence, points evenly spread, fine voxels (see `Codec.encode_within`). `budget_bytes` count the envelope.
    A message without objects is sent even if that alone is larger: it says where the agent is. Decoded messages may be
    shared by all agents of an episode.

    Raises:
        InvalidValueError: the uplink's codec cannot leave anything out.
    """

    def __init__(
        self, uplink: Uplink, budget_bytes: int, make_selection: MakeSelection, decoded: DecodeOnce | None = None
    ) -> None:
        require_count(1, budget_bytes=budget_bytes)
        if isinstance(uplink, ContentUplink):
            uplink.prepare_budget()
        _require_divisible(uplink)
        self.content = uplink.content  # type: ignore[misc]  # of the class elsewhere
        self.beside = uplink.beside
        self._uplink, self._budget_bytes, self._make_selection = uplink, budget_bytes, make_selection
        self._selections: dict[str, Selection] = {}
        self._decoded = decoded or DecodeOnce()

    def message(self, sender: str, observation: Observation) -> Message | None:
        return self.messages({sender: observation}).get(sender)

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        uplink = self._uplink
        if not isinstance(uplink, ContentUplink):
            return uplink.messages(observations)
        contents = uplink.contents(observations)
        return {sender: self._fitting(uplink, sender, observations[sender], contents[sender]) for sender in contents}

    def hear(self, receiver: str, observation: Observation) -> None:
        self._uplink.hear(receiver, observation)
        if self.content == "detections":
            self._selection(receiver).hear(observation, self._decoded)

    def _fitting(self, uplink: ContentUplink[Any], sender: str, observation: Observation, content: Any) -> Message:
        message = uplink.message_with(sender, observation, uplink.encode_content(sender, content))
        size_bytes = len(encode_message(message))
        if size_bytes > self._budget_bytes:
            if self.content == "detections":
                content = self._ranked(uplink, sender, observation, content)
            envelope_bytes = size_bytes - len(message.payload)
            payload = uplink.codec.encode_within(content, self._budget_bytes - envelope_bytes)
            message = replace(message, payload=payload)
        if self.content == "detections":
            self._selection(sender).sent(message, self._decoded)
        return message

    def _ranked(self, uplink: ContentUplink[Any], sender: str, observation: Observation, content: Any) -> Any:
        """Return the content with its most useful objects first."""
        if isinstance(content, Detections):
            return content[self._selection(sender).order(sender, replace(observation, detections=content))]
        ranked = observation.detections[self._selection(sender).order(sender, observation)]
        return uplink.content_of(sender, replace(observation, detections=ranked))

    def _selection(self, agent: str) -> Selection:
        if agent not in self._selections:
            self._selections[agent] = self._make_selection(agent)
        return self._selections[agent]


def _require_divisible(uplink: Uplink) -> None:
    if isinstance(uplink, Silence) or (isinstance(uplink, ContentUplink) and uplink.codec.divisible):
        return
    accepted = [name for name in codecs_of(uplink.content) if CODECS.get(name)().divisible]
    hint = f"; accepted codecs: {', '.join(accepted)}" if accepted else ""
    raise InvalidValueError(
        "budget_bytes is for uplinks whose codec can leave out the least useful part of a message, not for "
        f"{type(uplink).__name__}{hint}"
    )
