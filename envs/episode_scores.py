"""The records of an episode, and the scores that they come to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from coopsim.episode import RECORDERS, Episode, Recorder
from coopsim.errors import EpisodeStateError
from coopsim.metrics.built_in import recorders_read
from coopsim.metrics.recorders import TRACKS
from coopsim.metrics.score import FalsePositives, Score, summarize
from coopsim.metrics.scorer import TrackRecorder


class EpisodeScores:
    """The recorders of an episode whose records metrics read.

    Args:
        episode: the episode, before its first report.
        false_positives: the option of that name.
        view: is told, too.

    Attributes:
        tracks: recorder of reported tracks.
    """

    def __init__(self, episode: Episode, false_positives: FalsePositives, view: Recorder) -> None:
        self._false_positives, self.tracks = false_positives, TrackRecorder()
        read = {name: RECORDERS.get(name)() for name in recorders_read() if name != TRACKS}
        self._recorders: dict[str, Recorder] = {TRACKS: self.tracks, **read}
        self._told = (*self._recorders.values(), view)
        for each in self._told:
            each.begin(episode)

    def on_report(self, episode: Episode) -> None:
        """Tell the recorders of a report."""
        for each in self._told:
            each.on_report(episode)

    def on_step(self, episode: Episode) -> None:
        """Tell the recorders of a step."""
        for each in self._told:
            each.on_step(episode)

    @property
    def records(self) -> dict[str, dict[str, Any]]:
        """The records for metrics, by the recorder's name and by agent."""
        return {name: dict(each.records()) for name, each in self._recorders.items()}

    def score(self, bytes_per_s: Callable[[str], float]) -> Score:
        """Return the episode's score so far, given a function of an agent to the bytes that it sends in a second.

        Raises:
            EpisodeStateError: nothing has been scored yet.
        """
        records = self.records
        logs = records.pop(TRACKS)
        if not any(len(log) for log in logs.values()):
            raise EpisodeStateError("nothing has been scored yet: call reset, then step")
        return Score.mean(
            {
                agent: summarize(
                    [log],
                    false_positives=self._false_positives,
                    bytes_per_s=bytes_per_s(agent),
                    records={name: [kept[agent]] for name, kept in records.items() if agent in kept},
                )
                for agent, log in logs.items()
            }
        )
