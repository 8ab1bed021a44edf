"""Scores of the tracks that agents report, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.envs.frames import AgentFrame
from coopsim.geometry.boxes import in_region
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.types import Mask, Tracks


class Scorer:
    """Evaluators of an episode, by agent; the region is half the length and width (m) that counts, None: unlimited."""

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
        return None if self._region_m is None else in_region(tracks.boxes.center, self._region_m)
