"""The radio channel: an event queue in integer nanoseconds.

Every message is offered to every other agent. Per link it is lost, or delivered when it has been sent and its delay has
passed, and nothing else: sent = delivered + lost + pending at all times.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from coopsim.comms.bandwidth import Medium
from coopsim.comms.config import ChannelConfig
from coopsim.comms.link import Link
from coopsim.comms.message import decode_message, encode_message
from coopsim.comms.radio import Fading
from coopsim.comms.sight import Surroundings
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.rng import stream
from coopsim.types import Message, seconds_to_ns

__all__ = ["Channel", "ChannelConfig", "ChannelCounts"]

_ROUNDING_NS = 2
"""Frames' times and delays are rounded to whole nanoseconds: two thirtieths of a second must be two frames."""

LinkName = tuple[str, str]
"""Sender and receiver."""


@dataclass(frozen=True, slots=True)
class ChannelCounts:
    """Messages since the episode's start; `sent == delivered + lost + pending`.

    Attributes:
        sent: each message once for every receiver it was meant for.
        delivered: how many of them arrived.
        lost: how many never will.
        pending: how many wait for the medium, or are on their way.
        corrupted: how many of the lost arrived with a wrong checksum.
        stale: how many of the lost waited too long for the medium.
        duplicates: second copies that arrived; they are in none of the other counts.
        rejected: how many of those that arrived a policy could not read (`Policy.rejected`). The channel does not read
            them: it is 0 in the channel's own counts.
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
    """A message on one link that is not lost on the way, unless it waits too long."""

    number: int
    link: LinkName
    wire: bytes
    delays_ns: tuple[int, ...]  # of the message and, where there is one, of its duplicate


@dataclass(frozen=True, slots=True, order=True)
class _Arrival:
    """Messages that are due at the same moment arrive in the order of sending."""

    due_ns: int
    number: int
    copy: int
    link: LinkName = field(compare=False)
    wire: bytes = field(compare=False)


class Channel:
    """One episode's channel between named agents.

    Each link (sender, receiver) has its own random streams, one for each purpose, and takes the same draws for each
    message whatever the parameters, so that a run with more loss loses the same messages and more. Shadowing has a
    stream for each pair: it is the same in both directions.
    """

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        self._links: dict[LinkName, Link] = {}
        self._fading: dict[LinkName, Fading] = {}
        self._media: dict[LinkName | None, Medium[tuple[_Transmission, ...]]] = {}
        self._arrivals: list[_Arrival] = []
        self._offered_ns: dict[str, int] = {}
        self._number = 0
        self._counted: dict[str, Counter[LinkName]] = {
            name: Counter() for name in ("sent", "delivered", "lost", "corrupted", "stale", "duplicates")
        }
        self._broadcast_bytes: Counter[str] = Counter()

    def send(
        self, message: Message, now_ns: int, positions: Mapping[str, Floats], around: Surroundings | None = None
    ) -> None:
        """Broadcast a message, unless the sender's clock says that it is not time to; time must not go back.

        Args:
            message: what the sender says; it is stamped by the sender's clock.
            now_ns: when it is there.
            positions: true positions (3,) m of all agents, in one frame.
            around: where antennas and obstacles are, if the channel has a radio; None: all links are free.
        """
        sender, clock = message.sender, self._config.clock(message.sender)
        before_ns, self._offered_ns[sender] = self._offered_ns.get(sender), now_ns
        if not clock.ticks(before_ns, now_ns):
            return
        wire = encode_message(replace(message, captured_ns=clock.stamp_ns(message.captured_ns)))
        self._broadcast_bytes[sender] += len(wire)
        surroundings = around or Surroundings(positions)
        transmissions = [
            self._transmit((sender, receiver), wire, positions, surroundings)
            for receiver in positions
            if receiver != sender
        ]
        self._queue(transmissions, len(wire), now_ns + seconds_to_ns(self._config.processing_s))

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        """Take out every message that is due, by receiver, in order of arrival."""
        self._advance(now_ns + _ROUNDING_NS + 1)
        inboxes: dict[str, list[Message]] = {}
        read: dict[bytes, Message | None] = {}  # a broadcast is decoded once, not by each receiver
        while self._arrivals and self._arrivals[0].due_ns <= now_ns + _ROUNDING_NS:
            arrival = heapq.heappop(self._arrivals)
            if arrival.wire not in read:
                read[arrival.wire] = _readable(arrival.wire)
            message = read[arrival.wire]
            if message is None:
                if not arrival.copy:
                    self._count(arrival.link, "lost", "corrupted")
                continue
            inboxes.setdefault(arrival.link[1], []).append(message)
            self._count(arrival.link, "duplicates" if arrival.copy else "delivered")
        return inboxes

    @property
    def counts(self) -> ChannelCounts:
        """What became of the messages so far, on all links together."""
        counted = {name: counter.total() for name, counter in self._counted.items()}
        return ChannelCounts(**counted, pending=self._pending().total())

    @property
    def link_counts(self) -> Mapping[LinkName, ChannelCounts]:
        """What became of the messages so far, by sender and receiver."""
        pending = self._pending()
        return {
            link: ChannelCounts(
                **{name: counter[link] for name, counter in self._counted.items()}, pending=pending[link]
            )
            for link in self._counted["sent"]
        }

    def broadcast_bytes(self, agent: str) -> int:
        """Bytes that an agent has put on the air, or in the queue for it, each broadcast counted once."""
        return self._broadcast_bytes[agent]

    def _transmit(
        self, link: LinkName, wire: bytes, positions: Mapping[str, Floats], surroundings: Surroundings
    ) -> tuple[LinkName, _Transmission | None]:
        """A message on one link, None where it is lost on the way."""
        if link not in self._links:
            self._links[link] = Link(self._config, self._seed, link)
        self._count(link, "sent")
        self._number += 1
        distance_m = float(np.linalg.norm(positions[link[1]] - positions[link[0]]))
        chance = self._reception(link, surroundings) if distance_m <= self._config.range_m else 0.0
        fate = self._links[link].draw(wire, chance)
        if fate is None:
            self._count(link, "lost")
            return link, None
        return link, _Transmission(self._number, link, fate.wire, fate.delays_ns)

    def _reception(self, link: LinkName, surroundings: Surroundings) -> float:
        radio = self._config.radio
        if radio is None:
            return 1.0
        first, second = sorted(link)
        if (first, second) not in self._fading:
            rng = stream(self._seed, "shadowing", first, second)
            self._fading[first, second] = Fading(rng, radio.decorrelation_m)
        ends_m = np.stack([surroundings.antennas[first], surroundings.antennas[second]])
        fading = self._fading[first, second].at(ends_m)
        distance_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
        return radio.reception(radio.snr_db(distance_m, surroundings.between(first, second), fading))

    def _queue(self, links: list[tuple[LinkName, _Transmission | None]], size_bytes: int, ready_ns: int) -> None:
        """Hand transmissions to the medium; those that will be lost take their time on it, too."""
        bandwidth = self._config.bandwidth
        if bandwidth is None:
            self._send_off(tuple(each for _, each in links if each is not None), ready_ns)
            return
        shares: list[tuple[LinkName | None, tuple[_Transmission, ...]]]
        if bandwidth.medium == "shared":
            shares = [(None, tuple(each for _, each in links if each is not None))]
        else:
            shares = [(link, () if each is None else (each,)) for link, each in links]
        self._advance(ready_ns)
        for medium, transmissions in shares:
            self._media.setdefault(medium, Medium(bandwidth)).put(transmissions, size_bytes, ready_ns)

    def _advance(self, before_ns: int) -> None:
        """Let the media send what they begin to send before that moment."""
        for medium in self._media.values():
            for departure in medium.departures(before_ns):
                if departure.sent_ns is not None:
                    self._send_off(departure.content, departure.sent_ns)
                    continue
                for transmission in departure.content:
                    self._count(transmission.link, "lost", "stale")

    def _send_off(self, transmissions: tuple[_Transmission, ...], sent_ns: int) -> None:
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


def _readable(wire: bytes) -> Message | None:
    """The message, or None where its bytes were damaged on the way."""
    try:
        return decode_message(wire)
    except CodecError:
        return None
