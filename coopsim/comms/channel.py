"""The radio channel: an event queue in integer nanoseconds.

Every message is offered to every other agent. Per link it is out of range, lost, or delivered when its delay
has passed, and nothing else: sent = delivered + lost + pending at all times.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from coopsim.checks import require_number
from coopsim.comms.latency import GaussianLatency
from coopsim.comms.loss import BernoulliLoss
from coopsim.comms.message import decode_message, encode_message
from coopsim.geometry.se3 import Floats
from coopsim.rng import stream
from coopsim.types import Message

_ROUNDING_NS = 2
"""Frames' times and delays are rounded to whole nanoseconds: two thirtieths of a second must be two frames."""


@dataclass(frozen=True, slots=True)
class ChannelConfig:
    """What the channel does to messages; the default is ideal.

    Attributes:
        latency: delay of each message on each link.
        loss: loss of each message on each link.
        range_m: farther apart than this, nothing arrives.
    """

    latency: GaussianLatency = field(default_factory=GaussianLatency)
    loss: BernoulliLoss = field(default_factory=BernoulliLoss)
    range_m: float = np.inf

    def __post_init__(self) -> None:
        require_number(">= 0 (inf: no limit)", lambda far: far >= 0, communication_range_m=self.range_m)


@dataclass(frozen=True, slots=True)
class ChannelCounts:
    """Messages per link since the episode's start; `sent == delivered + lost + pending`."""

    sent: int
    delivered: int
    lost: int
    pending: int


class Channel:
    """One episode's channel between named agents.

    Each link (sender, receiver) has its own random stream and takes the same draws from it whatever the
    configuration, so that a run with more loss loses the same messages and more.
    """

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        self._links: dict[tuple[str, str], np.random.Generator] = {}
        self._queue: list[tuple[int, int, str, bytes]] = []
        self._sent = self._delivered = self._lost = 0
        self._broadcast_bytes: Counter[str] = Counter()

    def send(self, message: Message, now_ns: int, positions: Mapping[str, Floats]) -> None:
        """Broadcast a message.

        Args:
            message: what the sender says.
            now_ns: when it goes on the air.
            positions: true positions (3,) m of all agents, in one frame.
        """
        wire = encode_message(message)
        self._broadcast_bytes[message.sender] += len(wire)
        for receiver, position in positions.items():
            if receiver == message.sender:
                continue
            rng = self._link(message.sender, receiver)
            lost, delay_ns = self._config.loss.draw(rng), self._config.latency.draw_ns(rng)
            distance_m = float(np.linalg.norm(position - positions[message.sender]))
            if lost or distance_m > self._config.range_m:
                self._lost += 1
            else:
                # The running number keeps the order of sending among messages due at the same moment.
                heapq.heappush(self._queue, (now_ns + delay_ns, self._sent, receiver, wire))
            self._sent += 1

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        """Take out every message that is due, by receiver, in order of arrival."""
        inboxes: dict[str, list[Message]] = {}
        read: dict[bytes, Message] = {}  # a broadcast is decoded once, not by each receiver
        while self._queue and self._queue[0][0] <= now_ns + _ROUNDING_NS:
            _, _, receiver, wire = heapq.heappop(self._queue)
            if wire not in read:
                read[wire] = decode_message(wire)
            inboxes.setdefault(receiver, []).append(read[wire])
            self._delivered += 1
        return inboxes

    @property
    def counts(self) -> ChannelCounts:
        """What became of the messages so far."""
        return ChannelCounts(self._sent, self._delivered, self._lost, len(self._queue))

    def broadcast_bytes(self, agent: str) -> int:
        """Bytes that an agent has put on the air, each broadcast counted once."""
        return self._broadcast_bytes[agent]

    def _link(self, sender: str, receiver: str) -> np.random.Generator:
        link = (sender, receiver)
        if link not in self._links:
            self._links[link] = stream(self._seed, "channel", *link)
        return self._links[link]
