"""Scores of the tracks that agents report, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from coopsim.episode import Episode, Recorder
from coopsim.geometry.boxes import in_region
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.metrics.track_log import TrackLog
from coopsim.types import Mask, Tracks

if TYPE_CHECKING:
    from coopsim.envs.frames import AgentFrame


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


class TrackRecorder(Recorder):
    """Reported tracks beside the truth, by agent.

    Attributes:
        counts: counts of the last report, by agent.
    """

    def begin(self, episode: Episode) -> None:
        env = episode.env
        # Of a recording, an episode need not have all possible agents.
        self._scorer = Scorer(tuple(episode.frame.agents), env.match_iou, env.region_m)
        self.counts: Mapping[str, FrameCounts] = {}

    def on_report(self, episode: Episode) -> None:
        self.counts = self._scorer.update(episode.frame.agents, episode.tracks)

    def records(self) -> dict[str, TrackLog]:
        return {name: evaluator.log for name, evaluator in self._scorer.evaluators.items()}
