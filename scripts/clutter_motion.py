"""Persistence of false detections in recordings: match them between frames after removing the car's motion.

The recordings have no poses. But most false detections stand still in the world, so between two frames most of them
shift alike, and that shift is the car's motion, well enough for a few seconds, without turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

NEAR_M = 1.5
"""Two false detections are the same if the later one is within this distance of the position expected for it."""

_POOLED = 5  # number of frames before and after that vote for one shift
_BIN_M = 0.1
_FASTEST_M, _ASIDE_M = 3.6, 1.0
_ELSEWHERE_M = np.array([0.0, 6.0])


@dataclass(frozen=True)
class Recurrence:
    """False detections that are found again some frames later.

    Attributes:
        share: of false detections found again, among those still within reach, less chance matches.
        first: rows of those found again.
        second: rows of the same ones, later.
        apart_m: (N, 2) displacement between the two, in the world.
        count: number of false detections looked for.
    """

    share: float
    first: Ints
    second: Ints
    apart_m: Floats
    count: int


class ClutterMotion:
    """False detections of all episodes, with the car's motion removed.

    Args:
        false: columns `episode`, `frame`, `x`, `y` (N,).
        reach_m: half lengths of the area in which the detector reports boxes, along x and y.
    """

    def __init__(self, false: dict[str, Floats], reach_m: tuple[float, float]) -> None:
        self._place = np.column_stack([false["x"], false["y"]])
        self._reach_m = np.array(reach_m) - NEAR_M
        self._rows = {
            episode: _by_frame(false["frame"], np.flatnonzero(false["episode"] == episode))
            for episode in np.unique(false["episode"])
        }
        self._path = {episode: self._drift(rows) for episode, rows in self._rows.items()}

    def after(self, lag: int) -> Recurrence:
        """Match false detections with those `lag` frames later."""
        matched, chance, first, second, apart = 0, 0, [], [], []
        count = 0
        for episode, rows in self._rows.items():
            path = self._path[episode]
            for frame in range(len(rows) - lag):
                expected = self._place[rows[frame]] + path[frame + lag] - path[frame]
                inside = (np.abs(expected) <= self._reach_m).all(axis=1)
                expected, now = expected[inside], self._place[rows[frame + lag]]
                count += len(expected)
                if not len(expected) or not len(now):
                    continue
                distance = np.linalg.norm(expected[:, None] - now, axis=2)
                elsewhere = np.linalg.norm(expected[:, None] + _ELSEWHERE_M - now, axis=2)
                near = distance.min(axis=1) < NEAR_M
                matched, chance = matched + near.sum(), chance + (elsewhere.min(axis=1) < NEAR_M).sum()
                nearest = distance.argmin(axis=1)[near]
                first.append(rows[frame][inside][near])
                second.append(rows[frame + lag][nearest])
                apart.append(now[nearest] - expected[near])
        by_chance = chance / count
        share = max((matched / count - by_chance) / (1 - by_chance), 0.0)
        return Recurrence(share, np.concatenate(first), np.concatenate(second), np.concatenate(apart), count)

    def _drift(self, rows: list[Ints]) -> Floats:
        """Return the displacement (F, 2) m of the world relative to the car since the first frame."""
        votes = np.stack([self._votes(rows[k], rows[k + 1]) for k in range(len(rows) - 1)])
        summed = np.cumsum(np.concatenate([np.zeros_like(votes[:1]), votes]), axis=0)
        steps = []
        for k in range(len(votes)):
            pooled = summed[min(k + _POOLED + 1, len(votes))] - summed[max(k - _POOLED, 0)]
            peak = np.unravel_index(np.argmax(uniform_filter(pooled, 5)), pooled.shape)
            steps.append([(peak[0] + 0.5) * _BIN_M - _FASTEST_M, (peak[1] + 0.5) * _BIN_M - _ASIDE_M])
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def _votes(self, before: Ints, after: Ints) -> Floats:
        """Return a histogram of the shifts of all pairs of two frames, in bins along and across."""
        shift = (self._place[after][None] - self._place[before][:, None]).reshape(-1, 2)
        bins = [np.arange(-_FASTEST_M, _ASIDE_M, _BIN_M), np.arange(-_ASIDE_M, _ASIDE_M + _BIN_M / 2, _BIN_M)]
        votes: Floats = np.histogram2d(shift[:, 0], shift[:, 1], bins)[0]
        return votes


def _by_frame(frame: Floats, rows: Ints) -> list[Ints]:
    """Split rows by frame, from 0 to the last."""
    numbers = frame[rows].astype(np.int64)
    order = np.argsort(numbers, kind="stable")
    ends = np.cumsum(np.bincount(numbers))
    return np.split(rows[order], ends[:-1])
