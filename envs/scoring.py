"""Scores of reported tracks, by one evaluator per agent, and rewards."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from coopsim.envs.frames import AgentFrame
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.types import GroundTruth, Ints, Tracks


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
        counts = {}
        for name, agent in frame.items():
            counted = agent.truth.counted
            counts[name] = self.evaluators[name].update(counted, self._relevant(agent.truth, counted, tracks[name]))
        return counts

    def _relevant(self, truth: GroundTruth, counted: GroundTruth, tracks: Tracks) -> Tracks:
        """Leave out tracks outside the region, and tracks on objects that do not count.

        A tracker that carries on an object that no agent sees any more is right to do so, and is neither
        rewarded nor punished for it.
        """
        if not len(tracks):
            return tracks
        if self._region_m is not None:
            x, y = np.abs(tracks.boxes.center[:, :2]).T
            tracks = tracks[(x <= self._region_m[0]) & (y <= self._region_m[1])]
        if truth.counts is None or not len(tracks) or truth.counts.all():
            return tracks
        on_ignored = _best_overlap(tracks, truth.boxes[~truth.counts], truth.label[~truth.counts])
        on_counted = _best_overlap(tracks, counted.boxes, counted.label)
        return tracks[(on_ignored < self._match_iou) | (on_counted >= on_ignored)]


def _best_overlap(tracks: Tracks, boxes: Boxes3D, label: Ints) -> Floats:
    """Return each track's largest 3D IoU with a box of its class, (N,)."""
    overlap = iou_3d(tracks.boxes.array, boxes.array)
    overlap[tracks.label[:, None] != label] = 0.0
    best: Floats = overlap.max(axis=1, initial=0.0)
    return best
