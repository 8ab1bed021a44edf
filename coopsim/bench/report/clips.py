"""Clips of the worst moments: the runs are repeated, which gives the same bits, and recorded from above."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.report.scene import Film, frame_data, home_of, map_data, tracks_data
from coopsim.bench.results.standings import Moment
from coopsim.episode import Recorder
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Tracks
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

T = TypeVar("T")


class RunCell(Protocol):
    """Runs a cell as the benchmark does, and tells recorders of it."""

    def __call__(self, cell: Cell, *recorders: Recorder) -> CellResult: ...


_POINTS_SHOWN = 500


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """A recorded moment.

    Attributes:
        agent: agent whose tracks are shown.
        start_s: time of the first frame since the episode's start.
        frames: frames of the window: truth, agents and points.
        worst: the agent's tracks in each frame of the run that fell behind.
        best: the agent's tracks in each frame of the best run.
    """

    moment: Moment
    agent: str
    start_s: float
    dt_s: float
    road_map: RoadMap
    frames: Sequence[BevFrame]
    worst: Sequence[Mapping[str, Tracks]]
    best: Sequence[Mapping[str, Tracks]]

    def data(self) -> dict[str, Any]:
        """Return plain data for the page's views from above."""
        home = home_of(self.frames)
        moment = self.moment
        return {
            "agent": self.agent,
            "start_s": round(self.start_s, 3),
            "dt_s": self.dt_s,
            "map": map_data(self.road_map, home),
            "frames": [frame_data(frame, home) for frame in self.frames],
            "runs": [
                {
                    "score": np.round(run.rewards[moment.first : moment.last], 3).tolist(),
                    "tracks": [tracks_data(each, home) for each in tracks],
                }
                for run, tracks in ((moment.worst, self.worst), (moment.best, self.best))
            ],
        }


def film(
    moments: Sequence[Moment], run: RunCell, time_limit_s: float = 120.0, clock: Callable[[], float] = time.monotonic
) -> tuple[tuple[Clip, ...], tuple[str, ...]]:
    """Repeat the runs of the moments, each once and up to the end of its last window, and record them.

    `run` runs a cell as the benchmark does. No moment is begun after `time_limit_s` of the `clock`. Return the clips,
    and a line for each moment that could not be recorded: its run failed, gave other rewards than in the benchmark, or
    the time was up.
    """
    started = clock()
    ends: dict[Cell, int] = {}
    for moment in moments:
        for result in (moment.worst, moment.best):
            ends[result.cell] = max(ends.get(result.cell, 0), moment.last)
    films: dict[Cell, Film | str] = {}
    clips: list[Clip] = []
    notes: list[str] = []
    for number, moment in enumerate(moments):
        if clock() - started > time_limit_s:
            left = len(moments) - number
            notes.append(
                f"{left} clip{'s are' if left > 1 else ' is'} left out, as time was up after {time_limit_s:g} s"
            )
            break
        for result in (moment.worst, moment.best):
            if result.cell not in films:
                films[result.cell] = _shoot(result, ends[result.cell], run)
        clip = _cut(moment, films[moment.worst.cell], films[moment.best.cell])
        if isinstance(clip, Clip):
            clips.append(clip)
        else:
            notes.append(clip)
    return tuple(clips), tuple(notes)


def _shoot(result: CellResult, frames: int, run: RunCell) -> Film | str:
    """Record the run's first frames, or return why that failed."""
    cell, film = result.cell, Film(_POINTS_SHOWN)
    rerun = run(replace(cell, frames=frames), film)
    return changed_since(f"{cell.policy}, seed {cell.seed}", rerun, result.rewards[:frames]) or film


def changed_since(name: str, again: CellResult, rewards: Floats) -> str | None:
    """Return a line about a run that failed when it was run again, or gave other rewards; None: it gave the same."""
    if again.failed:
        return f"{name}: it failed when it was run again: {again.reason}"
    if not np.array_equal(again.rewards, rewards, equal_nan=True):
        return f"{name}: run again it gave other rewards, so something changed since"
    return None


def pairs_in_time(pairs: Sequence[T], time_limit_s: float, clock: Callable[[], float], notes: list[str]) -> Iterator[T]:
    """Yield pairs of runs to be filmed until the time is up; then add a line to the notes about those left out."""
    started = clock()
    for number, pair in enumerate(pairs):
        if clock() - started > time_limit_s:
            left = len(pairs) - number
            notes.append(f"{left} pair{'s' * (left > 1)} left out, as time was up after {time_limit_s:g} s")
            return
        yield pair


def _cut(moment: Moment, worst: Film | str, best: Film | str) -> Clip | str:
    if isinstance(worst, str) or isinstance(best, str):
        return worst if isinstance(worst, str) else str(best)
    shown, rival = (film.frames[moment.first : moment.last] for film in (worst, best))
    present = tuple(shown[0].agents)
    agent = next((name for name in present if name == moment.agent), present[0])
    return Clip(
        moment,
        agent,
        start_s=shown[0].time_ns / NS_PER_S,
        dt_s=worst.dt_s,
        road_map=worst.road_map,
        frames=shown,
        worst=[_only(frame, agent) for frame in shown],
        best=[_only(frame, agent) for frame in rival],
    )


def _only(frame: BevFrame, agent: str) -> dict[str, Tracks]:
    return {name: tracks for name, tracks in frame.tracks.items() if name == agent}
