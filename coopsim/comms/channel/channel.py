"""Channel between agents: an event queue in integer nanoseconds.

Every message goes to every other agent. On each link it is either lost, or delivered after it has been sent and its
delay has passed: sent = delivered + lost + pending at all times.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from coopsim.comms.channel.bandwidth import Medium
from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.comms.channel.clock import AgentClock
from coopsim.comms.channel.link import Link
from coopsim.comms.envelope import decode_message, encode_message
from coopsim.comms.radio.air import Air, LinkName
from coopsim.comms.radio.obstruction import Surroundings
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Message, seconds_to_ns

__all__ = ["Channel", "ChannelConfig", "ChannelCounts"]

_ROUNDING_NS = 2
"""Tolerance for times and delays rounded to whole nanoseconds: two thirtieths of a second must be two frames."""


@dataclass(frozen=True, slots=True)
class ChannelCounts:
    """Numbers of messages since the episode's start; `sent == delivered + lost + pending`.

    Attributes:
        sent: messages, each counted once per receiver.
        delivered: messages that arrived.
        lost: messages that never arrive.
        pending: messages that wait for the medium or are on their way.
        corrupted: lost messages that arrived with a wrong checksum.
        stale: lost messages that waited too long for the medium.
        duplicates: second copies that arrived; they are in no other count.
        rejected: delivered messages that a policy could not read (`Policy.rejected`). The channel does not read
            payloads: it is 0 in the channel's counts.
    """

    sent: int = 0
    delivered: int = 0
    lost: int = 0
    pending: int = 0
    corrupted: int = 0
    stale: int = 0
    duplicates: int = 0
    rejected: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Transmission:
    """Message on one link that is delivered unless it waits too long for the medium."""

    number: int
    link: LinkName
    wire: bytes
    delays_ns: tuple[int, ...]  # of the message, and of its duplicate if any


@dataclass(frozen=True, slots=True, order=True)
class _Arrival:
    """Arrival of a message; those due at the same moment are in the order of sending."""

    due_ns: int
    number: int
    copy: int
    link: LinkName = field(compare=False)
    wire: bytes = field(compare=False)


class Channel:
    """Channel of one episode between named agents.

    Each link (sender, receiver) has its own random streams, one per purpose, and takes the same draws for each message
    whatever the parameters: a run with more loss loses the same messages and more.
    """

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        self._links: dict[LinkName, Link] = {}
        self._air = None if config.radio is None else Air(config.radio, seed)
        self._media: dict[LinkName | None, Medium[tuple[_Transmission, ...]]] = {}
        self._arrivals: list[_Arrival] = []
        self._clocks: dict[str, AgentClock] = {}
        self._offered_ns: dict[str, int] = {}
        self._number = 0
        self._counted: dict[str, Counter[LinkName]] = {
            name: Counter() for name in ("sent", "delivered", "lost", "corrupted", "stale", "duplicates")
        }
        self._broadcast_bytes: Counter[str] = Counter()

    def send(
        self,
        messages: Sequence[Message],
        now_ns: int,
        positions: Mapping[str, Floats],
        around: Surroundings | None = None,
    ) -> None:
        """Broadcast the messages of one moment, except for those of senders whose clocks have not ticked.

        Calls must be in order of time.

        Args:
            messages: at most one per agent; their capture times are replaced by the stamps of the senders' clocks.
            now_ns: true time.
            positions: true positions (3,) m of all agents, in one frame.
            around: antennas and obstacles, used if the channel has a radio; None: all links are free.
        """
        wires = {message.sender: self._stamped(message) for message in messages if self._ticks(message.sender, now_ns)}
        probabilities = self._reception_probabilities(wires, around or Surroundings(positions))
        for sender, wire in wires.items():
            self._broadcast_bytes[sender] += len(wire)
            transmissions = [
                self._transmit((sender, receiver), wire, positions, probabilities.get((sender, receiver), 1.0))
                for receiver in positions
                if receiver != sender
            ]
            self._queue(sender, transmissions, len(wire), now_ns)

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        """Take out every message that is due, by receiver, in order of arrival."""
        self._advance(now_ns + _ROUNDING_NS + 1)
        inboxes: dict[str, list[Message]] = {}
        decoded: dict[bytes, Message | None] = {}  # a broadcast is decoded once, not by each receiver
        while self._arrivals and self._arrivals[0].due_ns <= now_ns + _ROUNDING_NS:
            arrival = heapq.heappop(self._arrivals)
            if arrival.wire not in decoded:
                decoded[arrival.wire] = _decode_intact(arrival.wire)
            message = decoded[arrival.wire]
            if message is None:
                if not arrival.copy:
                    self._count(arrival.link, "lost", "corrupted")
                continue
            inboxes.setdefault(arrival.link[1], []).append(message)
            self._count(arrival.link, "duplicates" if arrival.copy else "delivered")
        return inboxes

    @property
    def counts(self) -> ChannelCounts:
        """Counts of all messages so far, on all links together."""
        counted = {name: counter.total() for name, counter in self._counted.items()}
        return ChannelCounts(**counted, pending=self._pending().total())

    @property
    def link_counts(self) -> Mapping[LinkName, ChannelCounts]:
        """Counts of all messages so far, by sender and receiver."""
        pending = self._pending()
        return {
            link: ChannelCounts(
                **{name: counter[link] for name, counter in self._counted.items()}, pending=pending[link]
            )
            for link in self._counted["sent"]
        }

    def broadcast_bytes(self, agent: str) -> int:
        """Return the bytes that an agent has sent or queued, each broadcast counted once."""
        return self._broadcast_bytes[agent]

    def _ticks(self, sender: str, now_ns: int) -> bool:
        before_ns, self._offered_ns[sender] = self._offered_ns.get(sender), now_ns
        return self._clock(sender).ticks(before_ns, now_ns)

    def _stamped(self, message: Message) -> bytes:
        stamp_ns = self._clock(message.sender).stamp_ns(message.captured_ns)
        return encode_message(replace(message, captured_ns=stamp_ns))

    def _clock(self, agent: str) -> AgentClock:
        if agent not in self._clocks:
            self._clocks[agent] = self._config.clock(agent).sample(stream(self._seed, "clock", agent))
        return self._clocks[agent]

    def _link(self, sender: str, receiver: str) -> Link:
        if (sender, receiver) not in self._links:
            self._links[sender, receiver] = Link(self._config, self._seed, (sender, receiver))
        return self._links[sender, receiver]

    def _reception_probabilities(self, wires: Mapping[str, bytes], around: Surroundings) -> Mapping[LinkName, float]:
        """Return the radio's reception probabilities by link; senders with wired links only are not on the air."""
        if self._air is None:
            return {}
        on_air = {
            sender: len(wire)
            for sender, wire in wires.items()
            if not all(self._link(sender, other).wired for other in around.antennas if other != sender)
        }
        return self._air.reception_probabilities(on_air, around)

    def _transmit(
        self, name: LinkName, wire: bytes, positions: Mapping[str, Floats], reception: float
    ) -> tuple[LinkName, _Transmission | None]:
        """Draw the fate of a message on one link: return its transmission, None if it is lost."""
        link = self._link(*name)
        self._count(name, "sent")
        self._number += 1
        if link.wired:
            reception = 1.0
        elif float(np.linalg.norm(positions[name[1]] - positions[name[0]])) > self._config.range_m:
            reception = 0.0
        fate = link.draw(wire, reception)
        if fate is None:
            self._count(name, "lost")
            return name, None
        return name, _Transmission(self._number, name, fate.wire, fate.delays_ns)

    def _queue(
        self, sender: str, links: list[tuple[LinkName, _Transmission | None]], size_bytes: int, now_ns: int
    ) -> None:
        """Hand transmissions to the medium; those that will be lost take their airtime, too."""
        ready_ns = now_ns + seconds_to_ns(self._config.processing_of(sender))
        bandwidth = self._config.bandwidth
        by_cable = [each for name, each in links if bandwidth is None or self._links[name].wired]
        self._send_off([each for each in by_cable if each is not None], ready_ns)
        on_air = [(name, each) for name, each in links if not self._links[name].wired]
        if bandwidth is None or not on_air:
            return
        shares: list[tuple[LinkName | None, tuple[_Transmission, ...]]]
        if bandwidth.medium == "shared":
            shares = [(None, tuple(each for _, each in on_air if each is not None))]
        else:
            shares = [(name, () if each is None else (each,)) for name, each in on_air]
        for name, transmissions in shares:
            self._media.setdefault(name, Medium(bandwidth)).put(transmissions, size_bytes, ready_ns, sender)

    def _advance(self, before_ns: int) -> None:
        """Let the media begin all sending that begins before that moment."""
        for medium in self._media.values():
            for departure in medium.departures(before_ns):
                if departure.sent_ns is not None:
                    self._send_off(departure.content, departure.sent_ns)
                    continue
                for transmission in departure.content:
                    self._count(transmission.link, "lost", "stale")

    def _send_off(self, transmissions: Sequence[_Transmission], sent_ns: int) -> None:
        for each in transmissions:
            for copy, delay_ns in enumerate(each.delays_ns):
                arrival = _Arrival(sent_ns + delay_ns, each.number, copy, each.link, each.wire)
                heapq.heappush(self._arrivals, arrival)

    def _count(self, link: LinkName, *names: str) -> None:
        for name in names:
            self._counted[name][link] += 1

    def _pending(self) -> Counter[LinkName]:
        on_the_way = Counter(arrival.link for arrival in self._arrivals if not arrival.copy)
        for medium in self._media.values():
            on_the_way.update(each.link for waiting in medium.waiting for each in waiting)
        return on_the_way


def _decode_intact(wire: bytes) -> Message | None:
    """Decode a message; return None if its bytes were corrupted on the way."""
    try:
        return decode_message(wire)
    except CodecError:
        return None
