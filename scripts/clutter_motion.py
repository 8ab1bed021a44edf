"""How false detections last: they are found again where the world has moved past the car.

The recordings have no poses. But most false detections stand in the world, so between two frames most of them move
alike, and that shift is the car's own motion, as far as it is needed here: for a few seconds, turns left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

NEAR_M = 1.5
"""A false detection within this distance of where another one should be by now is the same again."""

_POOLED = 5  # frames before and after whose shifts vote together
_BIN_M = 0.1
_FASTEST_M, _ASIDE_M = 3.6, 1.0
_ELSEWHERE_M = np.array([0.0, 6.0])


@dataclass(frozen=True)
class Again:
    """What became of false detections some frames later.

    Attributes:
        share: of those still within reach, how many were there again, less what chance alone brings.
        first: rows of those that were there again.
        second: rows of what they were by then.
        apart_m: (N, 2) how far those two are apart, in the world.
        count: how many were looked for.
    """

    share: float
    first: Ints
    second: Ints
    apart_m: Floats
    count: int


class ClutterMotion:
    """False detections of all episodes with the shift of the world taken out.

    Args:
        false: columns `episode`, `frame`, `x`, `y` (N,).
        reach_m: within which they are detected.
    """

    def __init__(self, false: dict[str, Floats], reach_m: tuple[float, float]) -> None:
        self._place = np.column_stack([false["x"], false["y"]])
        self._reach_m = np.array(reach_m) - NEAR_M
        self._rows = {
            episode: _by_frame(false["frame"], np.flatnonzero(false["episode"] == episode))
            for episode in np.unique(false["episode"])
        }
        self._path = {episode: self._drift(rows) for episode, rows in self._rows.items()}

    def after(self, lag: int) -> Again:
        """What became of them after so many frames."""
        again, chance, first, second, apart = 0, 0, [], [], []
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
                again, chance = again + near.sum(), chance + (elsewhere.min(axis=1) < NEAR_M).sum()
                nearest = distance.argmin(axis=1)[near]
                first.append(rows[frame][inside][near])
                second.append(rows[frame + lag][nearest])
                apart.append(now[nearest] - expected[near])
        by_chance = chance / count
        share = max((again / count - by_chance) / (1 - by_chance), 0.0)
        return Again(share, np.concatenate(first), np.concatenate(second), np.concatenate(apart), count)

    def _drift(self, rows: list[Ints]) -> Floats:
        """(F, 2) how far the world has moved past the car since the first frame."""
        votes = np.stack([self._votes(rows[k], rows[k + 1]) for k in range(len(rows) - 1)])
        summed = np.cumsum(np.concatenate([np.zeros_like(votes[:1]), votes]), axis=0)
        steps = []
        for k in range(len(votes)):
            pooled = summed[min(k + _POOLED + 1, len(votes))] - summed[max(k - _POOLED, 0)]
            peak = np.unravel_index(np.argmax(uniform_filter(pooled, 5)), pooled.shape)
            steps.append([(peak[0] + 0.5) * _BIN_M - _FASTEST_M, (peak[1] + 0.5) * _BIN_M - _ASIDE_M])
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def _votes(self, before: Ints, after: Ints) -> Floats:
        """How many pairs of two frames are so far apart, in bins along and aside."""
        shift = (self._place[after][None] - self._place[before][:, None]).reshape(-1, 2)
        bins = [np.arange(-_FASTEST_M, _ASIDE_M, _BIN_M), np.arange(-_ASIDE_M, _ASIDE_M + _BIN_M / 2, _BIN_M)]
        votes: Floats = np.histogram2d(shift[:, 0], shift[:, 1], bins)[0]
        return votes


def _by_frame(frame: Floats, rows: Ints) -> list[Ints]:
    """The rows of each frame, from 0 to the last."""
    numbers = frame[rows].astype(np.int64)
    order = np.argsort(numbers, kind="stable")
    ends = np.cumsum(np.bincount(numbers))
    return np.split(rows[order], ends[:-1])
