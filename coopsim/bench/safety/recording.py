"""Recordings of runs from above: what a driven car did, was told, saw and tracked, up to its crash."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.report.clips import RunCell, changed_since
from coopsim.bench.report.scene import Film
from coopsim.bench.safety.moments import BY_ITSELF, Events, find_moments, in_view, tracked
from coopsim.episode import Episode, Recorder
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.metrics.drive_events import find_events
from coopsim.metrics.drive_log import Drive
from coopsim.metrics.track_log import TrackLog
from coopsim.viz.bev import BevFrame
from coopsim.viz.false_tracks import is_false
from coopsim.world.snapshot import RoadMap

if TYPE_CHECKING:
    pass

_POINTS_SHOWN = 700


class Scenery(NamedTuple):
    """Content of a picture at one moment, in the world frame; bodies are x, y, length, width, m, and yaw, rad.

    Attributes:
        car: (5,) the driven car.
        acceleration_m_s2: along its heading.
        bodies: (N, 5) of all others but those in conflict.
        conflicts: bodies (5,) of what the car must not touch, each with whether it has a track.
        in_view: whether the car's own sensors see one of these.
        tracks: (M, 5) reported where something is.
        false_tracks: (K, 5) reported where nothing is.
        agents: places (2,) of all other agents.
        way: (K, 2) ahead of the car.
    """

    car: Floats
    acceleration_m_s2: float
    bodies: Floats
    conflicts: list[tuple[Floats, bool]]
    in_view: bool
    tracks: Floats
    false_tracks: Floats
    agents: dict[str, Floats]
    way: Floats


# Without slots, so that the events can be kept with it.
@dataclass(frozen=True, eq=False)
class Recording:
    """A run from above.

    Attributes:
        cell: the run.
        drive: the drive of its car, F frames.
        road_map: outlines of the place.
        frames: F - 1 frames with the points of the car's sweeps; nothing was reported for the last one.
        agent: name of the driven car.
        arrived: senders whose messages reached the car, of F frames.
        events: moments of the drive.
    """

    cell: Cell
    drive: Drive
    road_map: RoadMap
    frames: Sequence[BevFrame]
    agent: str
    arrived: Sequence[frozenset[str]]
    events: Events

    @property
    def end_s(self) -> float:
        """Time of the last frame."""
        return float(self.drive.time_s[-1])

    def at(self, time_s: float) -> Scenery:
        """Return the scenery at a time, between frames on a straight line."""
        drive, (frame, share) = self.drive, self._place(time_s)
        after, reported = min(frame + 1, len(drive) - 1), min(frame, len(drive) - 2)
        bodies = _between(drive.boxes[frame], drive.boxes[after], share)
        there = np.isfinite(bodies).all(axis=1)
        known, boxes = tracked(drive)[reported], drive.tracks[reported].boxes
        false = is_false(boxes, np.vstack([drive.boxes[reported], drive.car[reported]]))
        return Scenery(
            _between(drive.car[frame], drive.car[after], share),
            float(drive.acceleration_m_s2[after]),
            bodies[there & ~drive.in_conflict],
            [(bodies[k], bool(known[k])) for k in np.flatnonzero(there & drive.in_conflict)],
            bool(in_view(drive)[frame]),
            boxes[~false],
            boxes[false],
            self.others(reported),
            drive.ways[frame].points,
        )

    def others(self, frame: int) -> dict[str, Floats]:
        """Return the places (2,) m of the other agents in a frame."""
        bodies = self.frames[frame].agents.items()
        return {name: body.world_SE3_base.translation[:2] for name, body in bodies if name != self.agent}

    def points_at(self, time_s: float) -> Floats:
        """Return the points (P, 2) of the frame at a time."""
        return self.frames[min(self._place(time_s)[0], len(self.frames) - 1)].points[:, :2]

    def arrivals(self, time_s: float, within_s: float) -> Iterator[tuple[str, float]]:
        """Yield senders of messages that arrived in the time before, with seconds since then: each one's latest."""
        frame = self._place(time_s)[0]
        met = set[str]()
        for number in range(frame, -1, -1):
            age_s = time_s - float(self.drive.time_s[number])
            if age_s > within_s:
                return
            yield from ((sender, max(age_s, 0.0)) for sender in sorted(self.arrived[number] - met))
            met |= self.arrived[number]

    def _place(self, time_s: float) -> tuple[int, float]:
        """Return the frame before a time, and the share of the step after it that has passed."""
        times = self.drive.time_s
        frame = int(np.clip(np.searchsorted(times, time_s + 1e-9, side="right") - 1, 0, len(times) - 1))
        if frame == len(times) - 1:
            return frame, 0.0
        return frame, float(np.clip((time_s - times[frame]) / (times[frame + 1] - times[frame]), 0.0, 1.0))


def _between(before: Floats, after: Floats, share: float) -> Floats:
    """Return bodies (..., 5) between two moments, those of the first where the second lacks them."""
    turn = wrap_angle(after[..., 4] - before[..., 4])
    made = before + share * (after - before)
    made[..., 4] = before[..., 4] + share * turn
    found: Floats = np.where(np.isfinite(made), made, before)
    return found


class DriveFilm(Recorder):
    """Records a run with a driven car, frame by frame."""

    def __init__(self) -> None:
        self._film: Film | None = None
        self._agent = ""
        self._drive: Drive | None = None
        self._logs: Mapping[str, TrackLog] = {}

    def on_step(self, episode: Episode) -> None:
        env = episode.env
        if self._film is None:
            self._agent = next(iter(env.cars), "")
            self._film = Film(_POINTS_SHOWN, self._agent or None)
        self._film.on_step(episode)
        if self._agent and not env.agents:
            self._drive, self._logs = env.records["drives"][self._agent].drive, env.logs

    def recording(self, cell: Cell) -> Recording:
        """Return the recording of the whole run.

        Raises:
            InvalidValueError: no car was driven, or the episode did not end.
        """
        if self._drive is None or self._film is None:
            raise InvalidValueError("a recording needs a whole episode with a driven car: use control='planner'")
        drive, film = _with_conflict(self._drive), self._film
        first_seen = {agent: _first_seen(log, drive) for agent, log in self._logs.items() if agent != self._agent}
        watchers = {agent: frame for agent, frame in first_seen.items() if frame is not None}
        events = find_moments(drive, watchers, film.arrived)
        return Recording(cell, drive, film.road_map, film.frames, self._agent, film.arrived, events)


def _with_conflict(drive: Drive) -> Drive:
    """Return a drive in which the object that it crashed into is in conflict, where no script names another."""
    crash = None if drive.in_conflict.any() else find_events(drive).crash
    return drive if crash is None else replace(drive, in_conflict=drive.ids == crash.object_id)


def _first_seen(log: TrackLog, drive: Drive) -> int | None:
    """Return the first frame in which an agent's own sensors saw what the car must not touch; None: it never did."""
    flat = log.flat()
    seen = np.isin(flat.truth_id, drive.ids[drive.in_conflict]) & (flat.truth_seen_by == BY_ITSELF)
    rows = np.flatnonzero(seen)
    return int(np.searchsorted(flat.truth_start, rows[0], side="right") - 1) if len(rows) else None


def record(result: CellResult, run: RunCell) -> Recording | str:
    """Run a cell again and record it; return why that failed, where it failed or gave other values."""
    recorder, cell = DriveFilm(), result.cell
    again = run(cell, recorder)
    name = f"{cell.policy}, {cell.condition.scenario}, seed {cell.seed}"
    return changed_since(name, again, result.rewards) or recorder.recording(cell)
