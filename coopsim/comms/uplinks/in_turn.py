"""A ranking of detections that says objects in turn: `selection="in_turn"`."""

from __future__ import annotations

import numpy as np

from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import KEPT, REPORTED, SELECTIONS, Listening, nearest
from coopsim.geometry.se3 import Floats
from coopsim.types import Message, Observation

_CONFIRMED = 3  # times said; AB3DMOT reports a track from its third detection on
_LOST_FRAMES = 10.0  # over which losses are averaged: a second at 10 Hz
_TURNS = 4  # messages that must arrive if objects are said in turn: two of each half
_AGAIN, _REST, _DUE = -1.0, -3.0, 3.0  # chosen in towns 510 to 513, see docs/results/messages.md


class InTurn(Listening):
    """The ranking "need" with a rhythm: where few objects fit, those of the last message wait while others are said.

    A tracker keeps an object for some frames without a detection. So the utility of "need", without its factor for
    what the last message had, is multiplied by a rhythm: exp(-1) for an object of the last message that was said less
    than three times, exp(-3) for one that was said more often, exp(3) for one that was said two or three frames ago.
    Where all objects fit, or messages are lost, it gives way to the factor of "need": it counts with the share of
    objects that did not fit into the last message, times the probability that four messages in a row arrive.

    Args:
        rng: the agent's random stream; not used.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self._at, self._ago, self._times = np.zeros((0, 2)), np.zeros(0), np.zeros(0)
        self._share, self._lost = 0.0, 0.0

    def hear(self, observation: Observation, decoded: DecodeOnce) -> None:
        known = set(self.reports)
        super().hear(observation, decoded)
        if known:
            missing = len(known - {message.sender for message in observation.inbox}) / len(known)
            self._lost += (missing - self._lost) / _LOST_FRAMES

    def sent(self, message: Message, decoded: DecodeOnce) -> None:
        super().sent(message, decoded)
        said = np.zeros(len(self._at), dtype=bool)
        if self.own is not None:
            rows = nearest(self.own.position, self._at)
            said[rows[rows >= 0]] = True
            self._share = min(1.0, len(rows) / max(len(self._at), 1))
        self._ago += 1
        self._times = np.where(said, 1 + np.where(self._ago <= _CONFIRMED, self._times, 0), self._times)
        self._ago[said] = 1

    def utility(self, sender: str, observation: Observation) -> Floats:
        found = observation.detections
        position = found.boxes.transform(observation.pose.world_SE3_base).center[:, :2]
        self._follow(position)
        unseen, surer = self.others(sender, found.score, position)
        scarce = (1 - self._share) * (1 - self._lost) ** _TURNS
        last = self._ago == 1
        rhythm = np.select([last & (self._times < _CONFIRMED), last, self._ago <= _CONFIRMED], [_AGAIN, _REST, _DUE])
        kept = np.where(last, KEPT, 1.0) ** (1 - scarce)
        utility: Floats = found.score * unseen * np.power(REPORTED, surer) * kept * np.exp(scarce * rhythm)
        return utility

    def _follow(self, position: Floats) -> None:
        """Carry over to this frame's objects when and how often they were said."""
        before = nearest(position, self._at)
        known = before >= 0
        ago, times = np.full(len(position), np.inf), np.zeros(len(position))
        ago[known], times[known] = self._ago[before[known]], self._times[before[known]]
        self._at, self._ago, self._times = position, ago, times


SELECTIONS.register("in_turn")(InTurn)
