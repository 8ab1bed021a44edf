"""What the radio makes of the messages of one moment: who is received where, and who drowns whom out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.comms.radio import Fading, Radio
from coopsim.comms.sight import Sight, Surroundings
from coopsim.rng import stream
from coopsim.types import Ints

LinkName = tuple[str, str]
"""Sender and receiver."""


class Air:
    """The radio of one episode.

    With `Radio.slots`, every message begins in a slot of its sender's own luck and takes one for each block, around the
    end. In a slot an agent sends or hears (half duplex), and whoever else sends in it is interference. This is C-V2X's
    mode 4 with random selection: without sensing, without repetitions.

    Args:
        radio: of all agents.
        seed: the episode's seed. Shadowing has a stream for each pair: it is the same in both directions.
    """

    def __init__(self, radio: Radio, seed: int) -> None:
        self._radio, self._seed = radio, seed
        self._fading: dict[LinkName, Fading] = {}
        self._luck: dict[str, np.random.Generator] = {}

    def chances(self, sizes_bytes: Mapping[str, int], around: Surroundings) -> dict[LinkName, float]:
        """The chance that a message is received, in [0, 1], by link.

        Args:
            sizes_bytes: of the messages of this moment, by sender.
            around: where all agents are, and what is in between.
        """
        taken = {sender: self._slots(sender, self._radio.blocks(size)) for sender, size in sizes_bytes.items()}
        chances = {}
        for receiver in around.antennas:
            heard = {sender: self._hear(sender, receiver, around) for sender in taken if sender != receiver}
            on_air_mw = {sender: _milliwatts(dbm) * (taken[sender] > 0) for sender, (dbm, _) in heard.items()}
            silent = taken[receiver] == 0 if receiver in taken and self._radio.slots else True
            for sender, (dbm, sight) in heard.items():
                noise_mw = np.full(len(taken[sender]), _milliwatts(self._radio.noise_dbm))
                if self._radio.slots:
                    noise_mw += sum(on_air_mw[other] for other in heard if other != sender)
                received = self._radio.curve(sight).delivery(dbm - 10 * np.log10(noise_mw))
                chances[sender, receiver] = float(np.prod((received * silent) ** taken[sender]))
        return chances

    def _slots(self, sender: str, blocks: int) -> Ints:
        """(S,) how many of a message's blocks are in each slot; one for all where there are no slots."""
        count = self._radio.slots
        if count is None:
            return np.array([blocks])
        if sender not in self._luck:
            self._luck[sender] = stream(self._seed, "slot", sender)
        taken = self._luck[sender].integers(count) + np.arange(blocks)
        return np.bincount(taken % count, minlength=count)

    def _hear(self, sender: str, receiver: str, around: Surroundings) -> tuple[float, Sight]:
        """How strong a sender is at a receiver, dBm, and what is in between."""
        first, second = sorted((sender, receiver))
        if (first, second) not in self._fading:
            rng = stream(self._seed, "shadowing", first, second)
            self._fading[first, second] = Fading(rng, self._radio.decorrelation_m)
        ends_m = np.stack([around.antennas[first], around.antennas[second]])
        sight = around.between(first, second)
        distance_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
        return self._radio.received_dbm(distance_m, sight, self._fading[first, second].at(ends_m)), sight


def _milliwatts(dbm: float) -> float:
    return 10 ** (dbm / 10)
