"""Reception of the messages of one moment over the radio, with interference between them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from coopsim.comms.radio.obstruction import Obstruction, RadioScene
from coopsim.comms.radio.radio_config import DECORRELATION_M, Fading, Radio
from coopsim.support.rng import stream
from coopsim.types import Ints

LinkName = tuple[str, str]
"""Sender and receiver."""


class RadioReception:
    """Reception of one episode by radio, with interference.

    With `Radio.slots`, every message begins in a random slot and takes a slot for each block, cyclically. In a slot an
    agent either sends or receives (half duplex), and all other senders in the slot interfere. This is C-V2X's mode 4
    with random selection: without sensing, without repetitions. Shadowing has a stream for each pair of agents: it is
    the same in both directions.
    """

    def __init__(self, radio: Radio, seed: int) -> None:
        self._radio, self._seed = radio, seed
        self._fading: dict[LinkName, Fading] = {}
        self._luck: dict[str, np.random.Generator] = {}

    def reception_probabilities(self, sizes_bytes: Mapping[str, int], around: RadioScene) -> dict[LinkName, float]:
        """Return the probability of reception by link, for messages of these sizes by sender."""
        taken = {sender: self._slots(sender, self._radio.blocks(size)) for sender, size in sizes_bytes.items()}
        pairs = {_pair(*ends) for ends in product(taken, around.antennas) if ends[0] != ends[1]}
        levels = {pair: self._received(*pair, around) for pair in pairs}
        probabilities: dict[LinkName, float] = {}
        for receiver in around.antennas:
            signals = {sender: levels[_pair(sender, receiver)] for sender in taken if sender != receiver}
            for sender, (dbm, obstruction) in signals.items():
                others = [other for other in signals if other != sender] if self._radio.slots else []
                noise_mw = _milliwatts(self._radio.noise_dbm) + np.zeros(len(taken[sender]))
                for other in others:
                    noise_mw += _milliwatts(signals[other][0]) * (taken[other] > 0)
                received = self._radio.curve(obstruction).delivery(dbm - 10 * np.log10(noise_mw))
                if self._radio.slots and receiver in taken:
                    received = np.where(taken[receiver] > 0, 0.0, received)
                probabilities[sender, receiver] = float(np.prod(received ** taken[sender]))
        return probabilities

    def _slots(self, sender: str, blocks: int) -> Ints:
        """Draw the number of a message's blocks in each slot, (S,); without slots, S = 1."""
        count = self._radio.slots
        if count is None:
            return np.array([blocks])
        if sender not in self._luck:
            self._luck[sender] = stream(self._seed, "slot", sender)
        taken = self._luck[sender].integers(count) + np.arange(blocks)
        return np.bincount(taken % count, minlength=count)

    def _received(self, first: str, second: str, around: RadioScene) -> tuple[float, Obstruction]:
        """Return the power (dBm) that each of a pair receives of the other, and the obstruction between them."""
        if (first, second) not in self._fading:
            rng = stream(self._seed, "shadowing", first, second)
            self._fading[first, second] = Fading(rng)
        ends_m = np.stack([around.antennas[first], around.antennas[second]])
        obstruction = around.between(first, second)
        distance_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
        fading = self._fading[first, second].at(ends_m, DECORRELATION_M[obstruction.state])
        return self._radio.received_dbm(distance_m, obstruction, fading), obstruction


def _pair(one: str, other: str) -> LinkName:
    """Return the key of two agents, in either order."""
    return min(one, other), max(one, other)


def _milliwatts(dbm: float) -> float:
    return 10 ** (dbm / 10)
