"""A ranking of detections that is learned: `selection="learned"`, or `learned(weights=FILE)`. Needs torch."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from coopsim.comms.uplinks.budget import SELECTIONS, Listening, Report
from coopsim.geometry.se3 import Floats
from coopsim.types import Mask, Observation

_UNIT_M = 50.0  # of distances
_LENGTH_M = 5.0  # of objects


@SELECTIONS.register("learned")
class Learned(Listening):
    """The objects first by which the other agents are expected to gain most, on average over these agents.

    A network of an object and a receiver says the gain, so any number of agents will do. It is trained by
    `examples/21_learn_what_to_say.py`. Where nobody has been heard, the highest scores come first.

    Args:
        rng: the agent's random stream; not used.
        weights: name of the network's weights, or path of their file.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: the weights are broken.
    """

    def __init__(self, rng: np.random.Generator, weights: str | Path = "what_to_say") -> None:
        super().__init__(rng)
        importlib.import_module("coopsim.nn")  # names the extra, where torch is missing
        from coopsim.learn.weights import load_ranking

        self.net = load_ranking(weights)

    def utility(self, sender: str, observation: Observation) -> Floats:
        rows = self.rows(observation)
        if not len(rows):
            return observation.detections.score
        utility: Floats = self.net.gains(rows).mean(axis=0) + float(self.net.keep) * rows[0, :, -1]
        return utility

    def rows(self, observation: Observation) -> Floats:
        """Return the network's input (R, N, 10), for each agent heard, in the order of `reports`, and each detection.

        The numbers: score; distance from the sender; the place in the receiver's frame, ahead and to a side, and its
        distance; the score with which the receiver itself reported the object, and the highest of third agents;
        distance of the nearest third agent; length; whether the sender's last message had it. Distances are in 50 m,
        lengths in 5 m.
        """
        found = observation.detections
        at = found.boxes.transform(observation.pose.world_SE3_base).center
        reports = list(self.reports.values())
        said = np.array([_said(report, at) for report in reports]).reshape(len(reports), len(at))
        places = np.array([report.world_SE3_base.translation[:2] for report in reports]).reshape(-1, 1, 2)
        away = np.hypot(*(at[:, :2] - places).transpose(2, 0, 1)) / _UNIT_M
        own = np.hypot(*found.boxes.center[:, :2].T) / _UNIT_M
        last = np.zeros(len(at), bool) if self.own is None else self.own.same_objects(at[:, :2]).any(axis=1)
        rows = np.zeros((len(reports), len(at), 10))
        for r, report in enumerate(reports):
            local, third = report.world_SE3_base.inverse().apply(at) / _UNIT_M, np.arange(len(reports)) != r
            by_third = said[third].max(axis=0, initial=0.0), away[third].min(axis=0, initial=2.0)
            place = local[:, 0], np.abs(local[:, 1]), away[r]
            length = found.boxes.size[:, 0] / _LENGTH_M
            rows[r] = np.column_stack([found.score, own, *place, said[r], *by_third, length, last])
        return rows


def _said(report: Report, at: Floats) -> Floats:
    """Return the highest score (N,) with which a report has the objects at `at` (N, 3); 0: it has them not."""
    same: Mask = report.same_objects(at[:, :2])
    score: Floats = (same * report.score).max(axis=1, initial=0.0)
    return score
