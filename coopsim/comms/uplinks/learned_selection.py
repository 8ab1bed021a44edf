"""A ranking of detections that is learned: `selection="learned"`, or `learned(weights=FILE)`. Needs torch."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import Listening, nearest
from coopsim.geometry.se3 import Floats
from coopsim.types import Message, Observation

_LEAST = 1e-3  # of what has a logarithm
_CONFIRMED = 3  # times said; AB3DMOT reports a track from its third detection on
_LOST_FRAMES = 10.0  # over which losses are averaged: a second at 10 Hz
_TURNS = 4  # messages that must arrive if objects are said in turn: two of each half


class Learned(Listening):
    """The quantities of "need", and the rhythm in which objects are repeated, with learned weights.

    A tracker keeps an object for some frames after the last message that had it. So a sender may say some objects in
    this frame and others in the next. How soon to say an object again is learned, by `examples/21_learn_what_to_say.py`
    from the score of whole episodes, for any number of agents.

    Args:
        rng: the agent's random stream; not used.
        weights: name of the weights, or path of their file.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: the weights are broken.
    """

    def __init__(self, rng: np.random.Generator, weights: str | Path) -> None:
        super().__init__(rng)
        importlib.import_module("coopsim.nn")  # names the extra, where torch is missing
        from coopsim.learn.weights import load_ranking

        self.weight: Floats = load_ranking(weights).weight.numpy().astype(np.float64)
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
        utility: Floats = self.rows(sender, observation) @ self.weight
        return utility

    def rows(self, sender: str, observation: Observation) -> Floats:
        """Return the numbers (N, 11) of the detections.

        They are the logarithms of the score and of the share of the others that are not likely to see the object, and
        the number of others who reported it with a higher score. Then four of the rhythm, each 1 or 0: said in the last
        message, and in less than three before; said in the last, and in three; said in the one before; said in the
        third last. They stand there twice: times `scarce`, and times 1 - `scarce`. That is the share of objects that
        did not fit into the last message, times the probability that four messages in a row arrive.
        """
        found = observation.detections
        position = found.boxes.transform(observation.pose.world_SE3_base).center[:, :2]
        self._follow(position)
        unseen, surer = self.others(sender, found.score, position)
        last, often = self._ago == 1, self._times >= _CONFIRMED
        rhythm = np.column_stack([last & ~often, last & often, self._ago == 2, self._ago == 3])
        scarce = (1 - self._share) * (1 - self._lost) ** _TURNS
        logs = np.log(np.maximum(np.column_stack([found.score, unseen]), _LEAST))
        return np.column_stack([logs, surer, scarce * rhythm, (1 - scarce) * rhythm])

    def _follow(self, position: Floats) -> None:
        """Carry over to this frame's objects when and how often they were said."""
        before = nearest(position, self._at)
        known = before >= 0
        ago, times = np.full(len(position), np.inf), np.zeros(len(position))
        ago[known], times[known] = self._ago[before[known]], self._times[before[known]]
        self._at, self._ago, self._times = position, ago, times
