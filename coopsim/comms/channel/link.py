"""A link between two agents: loss, delay, duplication and corruption of its messages, and their counts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.comms.channel.latency import fixed_delay_ns
from coopsim.comms.channel.loss import certain_loss
from coopsim.comms.radio.reception import LinkName
from coopsim.support.rng import stream
from coopsim.types import Ints


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
        dropped: lost messages for which a radio's or a receiver's memory had no room: see `Channel`.
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
    dropped: int = 0


_COUNTED = ("sent", "delivered", "lost", "corrupted", "stale", "duplicates", "dropped")


class LinkCounts:
    """Counts of all links between named agents; all kinds but `pending`, which the channel knows at any moment."""

    def __init__(self) -> None:
        self._number: dict[str, int] = {}
        self._counts = {kind: np.zeros((0, 0), np.int64) for kind in _COUNTED}

    def numbers(self, agents: Sequence[str]) -> Ints:
        """Return the numbers (N,) by which the counts know these agents; new ones are added."""
        for agent in agents:
            self._number.setdefault(agent, len(self._number))
        new = len(self._number) - len(self._counts["sent"])
        if new:
            self._counts = {kind: np.pad(counts, (0, new)) for kind, counts in self._counts.items()}
        return np.array([self._number[agent] for agent in agents], dtype=np.int64)

    def add(self, sender: int, receivers: Ints, *kinds: str) -> None:
        """Count a message of one sender for each of its receivers (N,), all by number, as all of these kinds."""
        for kind in kinds:
            self._counts[kind][sender, receivers] += 1

    def total(self, pending: Iterable[tuple[int, Ints]]) -> ChannelCounts:
        """Return the counts of all links together; `pending` are sender and receivers, by number, of messages on their
        way.
        """
        counted = {kind: int(counts.sum()) for kind, counts in self._counts.items()}
        return ChannelCounts(**counted, pending=sum(len(receivers) for _, receivers in pending))

    def by_link(self, pending: Iterable[tuple[int, Ints]]) -> Mapping[LinkName, ChannelCounts]:
        """Return the counts of each link on which a message was sent."""
        waiting = np.zeros_like(self._counts["sent"])
        for sender, receivers in pending:
            waiting[sender, receivers] += 1
        names = list(self._number)
        return {
            (names[sender], names[receiver]): ChannelCounts(
                **{kind: int(counts[sender, receiver]) for kind, counts in self._counts.items()},
                pending=int(waiting[sender, receiver]),
            )
            for sender, receiver in np.argwhere(self._counts["sent"]).tolist()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Fate:
    """Bytes of a message that arrives, possibly corrupted, and the delays of it and of its second copy if any."""

    wire: bytes
    delays_ns: tuple[int, ...]


class Link:
    """Link from a sender to a receiver, with its own random streams, one per purpose, whose names begin with `streams`.

    A stream takes the same draws for each message. One whose draws can decide nothing in the whole episode, as those of
    a loss with probability 0, is not even made: no other purpose draws from it.

    Attributes:
        wired: a cable, without limits of range, radio or bandwidth.
        certain_delays_ns: the delays of every message in range, if nothing on the link is drawn; () if all are lost.
            None: draws matter.
    """

    def __init__(self, config: ChannelConfig, seed: int, link: tuple[str, str], streams: str = "") -> None:
        override = config.link(*link)
        self._streams = streams
        self.wired = override.wired
        self._seed, self._name = seed, link
        self._duplicates, self._bit_error_rate = config.duplication, config.bit_error_rate
        self._loss_model = override.loss or config.loss
        self._latency_model = override.latency or config.latency
        self._lost, self._delay_ns = certain_loss(self._loss_model), fixed_delay_ns(self._latency_model)
        on_air = config.radio is not None and not self.wired
        self._loss = None if self._lost is not None else self._stream("loss")
        self._reception = self._stream("reception") if on_air else None
        self._latency = None if self._delay_ns is not None else self._stream("latency")
        self._duplication = self._stream("duplication") if self._duplicates else None
        self._bits = self._stream("corruption") if self._bit_error_rate else None
        self._burst: bool | None = None
        drawn = (self._loss, self._reception, self._latency, self._duplication, self._bits)
        self.certain_delays_ns: tuple[int, ...] | None = None
        if self._delay_ns is not None and all(rng is None for rng in drawn):
            self.certain_delays_ns = () if self._lost else (self._delay_ns,)

    def draw(self, wire: bytes, reception: float) -> Fate | None:
        """Draw the fate of the next message, given the probability of its reception; None: it is lost."""
        lost, faded = self._lost, reception <= 0
        if self._loss is not None:
            lost, self._burst = self._loss_model.draw(self._loss, self._burst)
        if self._reception is not None:
            faded = self._reception.random() >= reception
        delay_ns = self._delay_ns
        if self._latency is not None:
            delay_ns = self._latency_model.draw_ns(self._latency)
        assert delay_ns is not None
        delays_ns: tuple[int, ...] = (delay_ns,)
        if self._duplication is not None:
            duplicated = self._duplication.random() < self._duplicates
            second_ns = self._latency_model.draw_ns(self._duplication)
            delays_ns = (delay_ns, second_ns) if duplicated else delays_ns
        if self._bits is not None:
            wire = self._corrupt(self._bits, wire)
        return None if lost or faded else Fate(wire, delays_ns)

    def _stream(self, purpose: str) -> np.random.Generator:
        return stream(self._seed, self._streams + purpose, *self._name)

    def _corrupt(self, bits: np.random.Generator, wire: bytes) -> bytes:
        """Flip each bit independently with the bit error rate."""
        flipped = int(bits.binomial(8 * len(wire), self._bit_error_rate))
        if not flipped:
            return wire
        places = bits.choice(8 * len(wire), flipped, replace=False, shuffle=False)
        noisy = np.frombuffer(wire, dtype=np.uint8).copy()
        np.bitwise_xor.at(noisy, places // 8, (1 << (places % 8)).astype(np.uint8))
        return noisy.tobytes()
