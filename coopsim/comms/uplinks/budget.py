"""Uplinks that keep their messages within a number of bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from coopsim.comms.codecs.codec import CODECS, codecs_of
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.envelope import encode_message
from coopsim.comms.uplinks.selection import Selection
from coopsim.comms.uplinks.uplink import ContentUplink, Silence, Uplink
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count
from coopsim.types import Detections, Message, Observation

MakeSelection = Callable[[str], Selection]
"""A new selection for an agent and an episode."""


class WithinBudget(Uplink):
    """The messages of another uplink, as much of them as fits, the most useful part first.

    Detections are ranked by a `Selection`; of other contents the codec decides what is least useful: cells and queries
    of low confidence, points evenly spread, fine voxels (see `Codec.encode_within`).

    Args:
        uplink: the other uplink; its codec must be able to leave something out.
        budget_bytes: largest size of a message on the air, envelope included. A message without objects is sent even
            if that alone is larger: it says where the agent is.
        make_selection: ranks the detections of one agent.
        decoded: memory of decoded messages, shared by all agents of an episode; None: one of its own.

    Raises:
        InvalidValueError: the uplink cannot leave anything out.
    """

    def __init__(
        self, uplink: Uplink, budget_bytes: int, make_selection: MakeSelection, decoded: DecodeOnce | None = None
    ) -> None:
        require_count(1, budget_bytes=budget_bytes)
        if isinstance(uplink, ContentUplink):
            uplink.prepare_budget()
        _require_divisible(uplink)
        self.content = uplink.content  # type: ignore[misc]  # of the class elsewhere
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
