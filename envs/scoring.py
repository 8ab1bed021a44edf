"""Scores of reported tracks, by one evaluator per agent, and rewards."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from coopsim.envs.frames import AgentFrame
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.types import Mask, Tracks


class Reward(ABC):
    """A rule that turns one frame's counts into one agent's reward."""

    @abstractmethod
    def __call__(self, counts: FrameCounts) -> float:
        """Return the reward for a frame with these counts."""


class MotaReward(Reward):
    """The frame's own MOTA as a reward: 1 - (FP + FN + IDSW) / GT, clipped at -1.

    A frame without ground truth gives 1 if nothing is reported, else the clipped value for GT = 1.
    """

    def __call__(self, counts: FrameCounts) -> float:
        """Return the frame's MOTA."""
        errors = counts.fp + counts.fn + counts.idsw
        return max(-1.0, 1.0 - errors / max(counts.gt, 1))


class Scorer:
    """The evaluators of one episode.

    Attributes:
        evaluators: by agent.

    Args:
        agents: their names.
        match_iou: 3D IoU from which a track is on an object.
        region_m: half length and width of the evaluation region; None: unlimited.
    """

    def __init__(
        self,
        agents: tuple[str, ...],
        match_iou: float,
        region_m: tuple[float, float] | None,
    ) -> None:
        self._match_iou, self._region_m = match_iou, region_m
        self.evaluators = {name: Evaluator(match_iou) for name in agents}

    def update(self, frame: Mapping[str, AgentFrame], tracks: Mapping[str, Tracks]) -> dict[str, FrameCounts]:
        """Score the tracks that agents report for one frame; each in the agent's base frame."""
        return {
            name: self.evaluators[name].update(agent.truth, tracks[name], self._in_region(tracks[name]))
            for name, agent in frame.items()
        }

    def _in_region(self, tracks: Tracks) -> Mask | None:
        """Return the mask (M,) of tracks inside the region; None: there is no limit."""
        if self._region_m is None:
            return None
        x, y = np.abs(tracks.boxes.center[:, :2]).T
        inside: Mask = (x <= self._region_m[0]) & (y <= self._region_m[1])
        return inside
