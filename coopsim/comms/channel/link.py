"""One link: loss, delay, duplication and corruption, whatever the positions of its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.support.rng import stream


@dataclass(frozen=True, slots=True, eq=False)
class Fate:
    """Fate of a message that arrives.

    Attributes:
        wire: its bytes as they arrive, possibly corrupted.
        delays_ns: of the message, and of its second copy if any.
    """

    wire: bytes
    delays_ns: tuple[int, ...]


class Link:
    """Link from a sender to a receiver, with its own random streams.

    Attributes:
        wired: a cable, without limits of range, radio or bandwidth.
    """

    def __init__(self, config: ChannelConfig, seed: int, link: tuple[str, str]) -> None:
        override = config.link(*link)
        self.wired = override.wired
        self._config = config
        self._loss_model = override.loss or config.loss
        self._latency_model = override.latency or config.latency
        self._loss, self._reception, self._latency, self._duplication, self._bits = (
            stream(seed, purpose, *link) for purpose in ("loss", "reception", "latency", "duplication", "corruption")
        )
        self._burst: bool | None = None

    def draw(self, wire: bytes, reception: float) -> Fate | None:
        """Draw the fate of the next message, given the radio's reception probability; None: it is lost."""
        lost, self._burst = self._loss_model.draw(self._loss, self._burst)
        faded = self._reception.random() >= reception
        delay_ns = self._latency_model.draw_ns(self._latency)
        duplicated = self._duplication.random() < self._config.duplication
        second_ns = self._latency_model.draw_ns(self._duplication)
        wire = self._corrupt(wire)
        if lost or faded:
            return None
        return Fate(wire, (delay_ns, second_ns) if duplicated else (delay_ns,))

    def _corrupt(self, wire: bytes) -> bytes:
        """Flip each bit independently with the bit error rate."""
        rate = self._config.bit_error_rate
        flipped = int(self._bits.binomial(8 * len(wire), rate)) if rate else 0
        if not flipped:
            return wire
        bits = self._bits.choice(8 * len(wire), flipped, replace=False, shuffle=False)
        noisy = np.frombuffer(wire, dtype=np.uint8).copy()
        np.bitwise_xor.at(noisy, bits // 8, (1 << (bits % 8)).astype(np.uint8))
        return noisy.tobytes()
