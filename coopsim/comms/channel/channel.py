"""Channel between agents: an event queue in integer nanoseconds.

Every message goes to every other agent. On each link it is either lost, or delivered after it has been sent and its
delay has passed: sent = delivered + lost + pending at all times.

A broadcast is one event for all receivers that it reaches alike, so an ideal channel has one event per message.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from coopsim.comms.channel.bandwidth import Medium
from coopsim.comms.channel.channel_config import AgentClock, ChannelConfig
from coopsim.comms.channel.link import ChannelCounts, Link, LinkCounts
from coopsim.comms.envelope import decode_message, encode_message
from coopsim.comms.radio.obstruction import RadioScene
from coopsim.comms.radio.reception import LinkName, RadioReception
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints, Mask, Message, seconds_to_ns

_ROUNDING = 1e-9
"""Relative difference from the range below which a distance is computed by itself, so that no pair depends on how many
there are."""


def out_of_range(places_m: Floats, range_m: float) -> Mask:
    """Return the mask (A, A) of pairs of agents at (A, 3) m that are farther apart than `range_m`."""
    if math.isinf(range_m):
        return np.zeros((len(places_m), len(places_m)), dtype=np.bool_)
    apart = places_m[:, None] - places_m
    square = np.einsum("ijk,ijk->ij", apart, apart)
    far: Mask = square > range_m**2
    near = np.abs(square - range_m**2) <= _ROUNDING * range_m**2
    for i, j in np.argwhere(near).tolist() if near.any() else ():
        far[i, j] = math.sqrt(apart[i, j].dot(apart[i, j])) > range_m
    return far


__all__ = ["Channel", "ChannelConfig", "ChannelCounts"]

MOST_FURTHER, MOST_FURTHER_BYTES = 1000, 64 * 2**20
"""Memory of a radio for messages on their way besides its agent's own: a flood fills it, and what comes then is
dropped. A thousand detections or two feature maps of a megabyte each frame, for 3 s, have room."""

MOST_IN_INBOX, MOST_INBOX_BYTES = 4096, 2**30
"""Memory of a receiver for the messages of one frame: more than a hundred agents send in 3 s at 10 Hz. More is
dropped."""

_FURTHER = "further "
"""Beginning of the names of the random streams of further messages: they shift no draw of an agent's own."""

_ROUNDING_NS = 2
"""Tolerance for times and delays rounded to whole nanoseconds: two thirtieths of a second must be two frames."""


class _Wire:
    """Bytes as they arrive, decoded once for all receivers and moments of arrival."""

    def __init__(self, content: bytes) -> None:
        self.size_bytes = len(content)
        self._content: bytes | None = content
        self._message: Message | None = None

    @property
    def message(self) -> Message | None:
        """The message; None if its bytes were corrupted on the way."""
        if self._content is not None:
            with suppress(CodecError):
                self._message = decode_message(self._content)
            self._content = None
        return self._message


@dataclass(frozen=True, slots=True, eq=False)
class _Transmission:
    """Message to some receivers that is delivered to all alike, unless it waits too long for the medium.

    Sender and `receivers` (N,) are their numbers in the counts; `names` are the receivers', `delays_ns` those of the
    message and of its duplicate if any. `number` counts broadcasts in the order of sending.
    """

    number: int
    sender: int
    receivers: Ints
    names: tuple[str, ...]
    wire: _Wire
    delays_ns: tuple[int, ...]

    def only(self, places: Sequence[int] | Ints) -> _Transmission:
        """Return the part of the receivers at these places (K,), which rise."""
        if len(places) == len(self.names):
            return self
        return replace(self, receivers=self.receivers[places], names=tuple(self.names[place] for place in places))


@dataclass(frozen=True, slots=True, eq=False)
class _Fan:
    """Links of one sender to all N others.

    Sender and `receivers` (N,) are their numbers in the counts, `places` (N,) the receivers' among all agents; `wired`
    (N,) marks cables. `certain_delays_ns` is that of all links alike, if nothing is drawn (see `Link`), or None.
    """

    sender: int
    names: tuple[str, ...]
    places: Ints
    receivers: Ints
    links: tuple[Link, ...]
    wired: Mask
    certain_delays_ns: tuple[int, ...] | None

    def only(self, chosen: Sequence[int]) -> _Fan:
        """Return the links to the receivers at these places (K,), which rise."""
        if len(chosen) == len(self.names):
            return self
        names, links = tuple(self.names[each] for each in chosen), tuple(self.links[each] for each in chosen)
        rows = np.array(chosen, dtype=np.int64)
        places, receivers, wired = self.places[rows], self.receivers[rows], self.wired[rows]
        return _Fan(self.sender, names, places, receivers, links, wired, self.certain_delays_ns)


class Channel:
    """Channel of one episode between named agents.

    Each link (sender, receiver) has its own random streams, one per purpose, and takes the same draws for each message
    whatever the parameters: a run with more loss loses the same messages and more.
    """

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        self._links: dict[tuple[LinkName, str], Link] = {}
        self._agents: tuple[str, ...] = ()
        self._fans: dict[tuple[str, str], _Fan] = {}  # between these agents, by sender and streams
        self._further: dict[int, tuple[str, int]] = {}  # radio and bytes of further messages, by number of broadcast
        self._reception_model = None if config.radio is None else RadioReception(config.radio, seed)
        self._media: dict[LinkName | None, Medium[tuple[_Transmission, ...]]] = {}
        # Due time, number of the broadcast, copy, serial number, and what arrives: a heap.
        self._arrivals: list[tuple[int, int, int, int, _Transmission]] = []
        self._clocks: dict[str, AgentClock] = {}
        self._offered_ns: dict[str, int] = {}
        self._broadcasts = self._events = 0  # numbers of both so far
        self._counts = LinkCounts()
        self._broadcast_bytes: Counter[str] = Counter()

    def send(
        self,
        messages: Sequence[Message],
        now_ns: int,
        positions: Mapping[str, Floats],
        around: RadioScene | None = None,
        to: Mapping[str, Collection[str]] | None = None,
        further: Mapping[str, Sequence[Message]] | None = None,
    ) -> None:
        """Broadcast the messages of one moment, except for those of senders whose clocks have not ticked.

        Calls must be in order of time. Capture times are replaced by the stamps of the senders' clocks, at most one
        message per agent. Positions are true ones (3,) m of all agents, in one frame; `around` is used if the channel
        has a radio. `to` has the receivers of each sender's message, by name; None: all. `further` are messages that an
        agent's radio sends besides, under whatever names; those for which it has no memory (`MOST_FURTHER`) are
        dropped.
        """
        wires = {message.sender: self._stamped(message) for message in messages if self._ticks(message.sender, now_ns)}
        if len(positions) == 1 and not further:  # nobody hears it, and nobody waits for the medium
            for sender, wire in wires.items():
                self._broadcast_bytes[sender] += len(wire)
            return
        besides = {name: [self._stamped(each, name) for each in sent] for name, sent in (further or {}).items()}
        sizes_bytes = {sender: len(wire) for sender, wire in wires.items()}
        for name, sent in besides.items():
            sizes_bytes[name] = sizes_bytes.get(name, 0) + sum(map(len, sent))
        probabilities = self._reception_probabilities(sizes_bytes, around or RadioScene(positions))
        agents = tuple(positions)
        far = out_of_range(np.array([*positions.values()]).reshape(-1, 3), self._config.range_m)
        for sender, wire in wires.items():
            fan = self._fan(sender, agents)
            if to is not None:
                fan = fan.only([place for place, name in enumerate(fan.names) if name in to[sender]])
            reception = self._reception(sender, fan, far[agents.index(sender)], probabilities)
            self._broadcast(sender, fan, wire, reception, now_ns)
        for name, sent in besides.items():
            fan = self._fan(name, agents, _FURTHER)
            reception = self._reception(name, fan, far[agents.index(name)], probabilities)
            self._broadcast_further(name, fan, sent, reception, now_ns)

    def _broadcast(self, sender: str, fan: _Fan, wire: bytes, reception: Floats, now_ns: int) -> None:
        self._broadcast_bytes[sender] += len(wire)
        self._queue(sender, fan, self._transmit(fan, wire, reception), len(wire), now_ns)

    def _broadcast_further(self, name: str, fan: _Fan, wires: Sequence[bytes], reception: Floats, now_ns: int) -> None:
        """Broadcast what a radio sends besides its agent's own message, as far as it has memory."""
        on_the_way = {each.number for each in self._on_the_way()}
        self._further = {number: known for number, known in self._further.items() if number in on_the_way}
        sizes = [size for radio, size in self._further.values() if radio == name]
        count, size_bytes = len(sizes), sum(sizes)
        for wire in wires:
            if count >= MOST_FURTHER or size_bytes + len(wire) > MOST_FURTHER_BYTES:
                self._counts.add(fan.sender, fan.receivers, "sent", "lost", "dropped")
                continue
            count, size_bytes = count + 1, size_bytes + len(wire)
            self._further[self._broadcasts] = name, len(wire)
            self._broadcast(name, fan, wire, reception, now_ns)

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        """Take out every message that is due, by receiver, in order of arrival."""
        self._advance(now_ns + _ROUNDING_NS + 1)
        inboxes: defaultdict[str, list[Message]] = defaultdict(list)
        free_bytes: defaultdict[str, int] = defaultdict(lambda: MOST_INBOX_BYTES)
        while self._arrivals and self._arrivals[0][0] <= now_ns + _ROUNDING_NS:
            _, _, copy, _, arrived = heapq.heappop(self._arrivals)
            message = arrived.wire.message
            if message is not None:
                size_bytes, full = arrived.wire.size_bytes, list[int]()
                for place, receiver in enumerate(arrived.names):
                    if len(inboxes[receiver]) >= MOST_IN_INBOX or size_bytes > free_bytes[receiver]:
                        full.append(place)
                        continue
                    inboxes[receiver].append(message)
                    free_bytes[receiver] -= size_bytes
                if full and not copy:
                    self._counts.add(arrived.sender, arrived.receivers[full], "lost", "dropped")
                reached = np.delete(arrived.receivers, full) if full else arrived.receivers
                self._counts.add(arrived.sender, reached, "duplicates" if copy else "delivered")
            elif not copy:
                self._counts.add(arrived.sender, arrived.receivers, "lost", "corrupted")
        return dict(inboxes)

    @property
    def counts(self) -> ChannelCounts:
        """Counts of all messages so far, on all links together."""
        return self._counts.total(self._pending())

    @property
    def link_counts(self) -> Mapping[LinkName, ChannelCounts]:
        """Counts of all messages so far, by sender and receiver."""
        return self._counts.by_link(self._pending())

    def broadcast_bytes(self, agent: str) -> int:
        """Return the bytes that an agent has sent or queued, each broadcast counted once."""
        return self._broadcast_bytes[agent]

    def _ticks(self, sender: str, now_ns: int) -> bool:
        before_ns, self._offered_ns[sender] = self._offered_ns.get(sender), now_ns
        return self._clock(sender).ticks(before_ns, now_ns)

    def _stamped(self, message: Message, radio: str | None = None) -> bytes:
        """Return the message with the stamp of its radio's clock; None: its sender's."""
        stamp_ns = self._clock(radio or message.sender).stamp_ns(message.captured_ns)
        return encode_message(message if stamp_ns == message.captured_ns else replace(message, captured_ns=stamp_ns))

    def _clock(self, agent: str) -> AgentClock:
        if agent not in self._clocks:
            self._clocks[agent] = self._config.clock(agent).sample(stream(self._seed, "clock", agent))
        return self._clocks[agent]

    def _link(self, sender: str, receiver: str, streams: str = "") -> Link:
        name = (sender, receiver), streams
        if name not in self._links:
            self._links[name] = Link(self._config, self._seed, *name)
        return self._links[name]

    def _fan(self, sender: str, agents: tuple[str, ...], streams: str = "") -> _Fan:
        """Return the links from a sender to all other agents."""
        if agents != self._agents:
            self._agents, self._fans = agents, {}
        if (sender, streams) not in self._fans:
            names = tuple(name for name in agents if name != sender)
            links = tuple(self._link(sender, name, streams) for name in names)
            certain = {link.certain_delays_ns for link in links}
            self._fans[sender, streams] = _Fan(
                int(self._counts.numbers([sender])[0]),
                names,
                np.array([place for place, name in enumerate(agents) if name != sender], dtype=np.int64),
                self._counts.numbers(names),
                links,
                np.array([link.wired for link in links], dtype=np.bool_),
                certain.pop() if len(certain) == 1 else None,
            )
        return self._fans[sender, streams]

    def _reception_probabilities(self, sizes_bytes: Mapping[str, int], around: RadioScene) -> Mapping[LinkName, float]:
        """Return the radio's reception probabilities by link; senders with wired links only are not on the air."""
        if self._reception_model is None:
            return {}
        on_air = {
            sender: size
            for sender, size in sizes_bytes.items()
            if not all(self._link(sender, other).wired for other in around.antennas if other != sender)
        }
        return self._reception_model.reception_probabilities(on_air, around)

    def _reception(self, sender: str, fan: _Fan, far: Mask, probabilities: Mapping[LinkName, float]) -> Floats:
        """Return the probability (N,) of reception by each receiver's radio; 0 for agents that are `far` (A,)."""
        received = np.ones(len(fan.names))
        if probabilities:
            received[:] = [probabilities.get((sender, name), 1.0) for name in fan.names]
        received[far[fan.places]] = 0.0
        received[fan.wired] = 1.0
        return received

    def _transmit(self, fan: _Fan, wire: bytes, reception: Floats) -> list[_Transmission]:
        """Draw the fate of a message on each link, and return a transmission for all links with the same fate.

        `reception` (N,) is the radio's probability of reception.
        """
        self._counts.add(fan.sender, fan.receivers, "sent")
        number, intact = self._broadcasts, _Wire(wire)
        self._broadcasts += 1
        if fan.certain_delays_ns and reception.all():
            return [_Transmission(number, fan.sender, fan.receivers, fan.names, intact, fan.certain_delays_ns)]
        alike: dict[tuple[bytes, tuple[int, ...]], list[int]] = {}
        if fan.certain_delays_ns is not None:
            if fan.certain_delays_ns:
                alike = {(wire, fan.certain_delays_ns): np.flatnonzero(reception > 0).tolist()}
        else:
            for place, (link, probability) in enumerate(zip(fan.links, reception.tolist(), strict=True)):
                fate = link.draw(wire, probability)
                if fate is not None:
                    alike.setdefault((fate.wire, fate.delays_ns), []).append(place)
        arriving = np.zeros(len(fan.names), dtype=np.bool_)
        sent = []
        for (content, delays_ns), places in alike.items():
            arriving[places] = True
            arrives = intact if content is wire else _Wire(content)
            whole = _Transmission(number, fan.sender, fan.receivers, fan.names, arrives, delays_ns)
            sent.append(whole.only(places))
        if not arriving.all():
            self._counts.add(fan.sender, fan.receivers[~arriving], "lost")
        return sent

    def _queue(self, sender: str, fan: _Fan, sent: Sequence[_Transmission], size_bytes: int, now_ns: int) -> None:
        """Hand transmissions to the medium; a message that all will lose takes its airtime, too."""
        ready_ns = now_ns + seconds_to_ns(self._config.processing_of(sender))
        bandwidth = self._config.bandwidth
        if bandwidth is None or fan.wired.all():
            self._send_off(sent, ready_ns)
            return
        wired = [np.isin(each.receivers, fan.receivers[fan.wired]) for each in sent]
        self._send_off([each.only(np.flatnonzero(mask)) for each, mask in zip(sent, wired, strict=True)], ready_ns)
        on_air = [each.only(np.flatnonzero(~mask)) for each, mask in zip(sent, wired, strict=True)]
        shares: dict[LinkName | None, tuple[_Transmission, ...]] = {None: tuple(on_air)}
        if bandwidth.medium == "link":
            shares = {(sender, name): () for name, link in zip(fan.names, fan.links, strict=True) if not link.wired}
            shares |= {
                (sender, name): (each.only([place]),) for each in on_air for place, name in enumerate(each.names)
            }
        for name, transmissions in shares.items():
            self._media.setdefault(name, Medium(bandwidth)).put(transmissions, size_bytes, ready_ns, sender)

    def _advance(self, before_ns: int) -> None:
        """Let the media begin all sending that begins before that moment."""
        for medium in self._media.values():
            for departure in medium.departures(before_ns):
                if departure.sent_ns is not None:
                    self._send_off(departure.content, departure.sent_ns)
                    continue
                for each in departure.content:
                    self._counts.add(each.sender, each.receivers, "lost", "stale")

    def _send_off(self, transmissions: Sequence[_Transmission], sent_ns: int) -> None:
        for each in transmissions:
            for copy, delay_ns in enumerate(each.delays_ns if each.names else ()):
                heapq.heappush(self._arrivals, (sent_ns + delay_ns, each.number, copy, self._events, each))
                self._events += 1

    def _pending(self) -> Iterator[tuple[int, Ints]]:
        """Yield sender and receivers, by number, of every message that has not arrived."""
        for each in self._on_the_way():
            yield each.sender, each.receivers

    def _on_the_way(self) -> Iterator[_Transmission]:
        """Yield every transmission that waits for a medium or has not arrived, without second copies."""
        for medium in self._media.values():
            for content in medium.waiting:
                yield from content
        yield from (each for _, _, copy, _, each in self._arrivals if not copy)
