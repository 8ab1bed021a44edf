"""What happens to messages on one link, apart from where its ends are and what else is on the air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.support.rng import stream


@dataclass(frozen=True, slots=True, eq=False)
class Fate:
    """A message that arrives.

    Attributes:
        wire: its bytes, some of them wrong where the link corrupts.
        delays_ns: of the message and, where it comes twice, of the second copy.
    """

    wire: bytes
    delays_ns: tuple[int, ...]


class Link:
    """One link from a sender to a receiver, with its own random streams.

    Attributes:
        wired: by cable: neither range nor radio nor bandwidth concern it.
    """

    def __init__(self, config: ChannelConfig, seed: int, link: tuple[str, str]) -> None:
        own = config.link(*link)
        self.wired = own.wired
        self._config = config
        self._loss_model = own.loss or config.loss
        self._latency_model = own.latency or config.latency
        self._loss, self._reception, self._latency, self._duplication, self._bits = (
            stream(seed, purpose, *link) for purpose in ("loss", "reception", "latency", "duplication", "corruption")
        )
        self._burst: bool | None = None

    def draw(self, wire: bytes, reception: float) -> Fate | None:
        """What becomes of the next message, which the radio brings over with a chance in [0, 1]; None: it is lost."""
        lost, self._burst = self._loss_model.draw(self._loss, self._burst)
        faded = self._reception.random() >= reception
        delay_ns = self._latency_model.draw_ns(self._latency)
        twice = self._duplication.random() < self._config.duplication
        second_ns = self._latency_model.draw_ns(self._duplication)
        wire = self._corrupt(wire)
        if lost or faded:
            return None
        return Fate(wire, (delay_ns, second_ns) if twice else (delay_ns,))

    def _corrupt(self, wire: bytes) -> bytes:
        """Each bit is flipped independently."""
        rate = self._config.bit_error_rate
        flipped = int(self._bits.binomial(8 * len(wire), rate)) if rate else 0
        if not flipped:
            return wire
        bits = self._bits.choice(8 * len(wire), flipped, replace=False, shuffle=False)
        noisy = np.frombuffer(wire, dtype=np.uint8).copy()
        np.bitwise_xor.at(noisy, bits // 8, (1 << (bits % 8)).astype(np.uint8))
        return noisy.tobytes()
