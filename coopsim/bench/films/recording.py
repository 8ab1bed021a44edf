"""Recordings of runs from above: what a driven car did, was told, saw and tracked, up to its crash."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coopsim.bench.films.drive_moments import Events, find_moments, in_view, tracked
from coopsim.bench.films.film import Film, FilmFrame
from coopsim.bench.films.space import short_ids
from coopsim.bench.grid.cell import Cell
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.metrics.drive_log import Drive
from coopsim.viz.false_tracks import is_false


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
        news: places (2,) of what messages have just told the car of, each with the share of its time that is over.
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
    news: list[tuple[Floats, float]]


# Without slots, so that the events can be kept with it.
@dataclass(frozen=True, eq=False)
class Recording:
    """A run with a driven car from above.

    Attributes:
        cell: the run.
        film: its film, of F - 1 frames; nothing was reported for the last one.
        agent: name of the driven car.
        drive: the drive of its car, F frames.
        events: moments of the drive.
    """

    cell: Cell
    film: Film
    agent: str
    drive: Drive
    events: Events

    @classmethod
    def of(cls, cell: Cell, film: Film) -> Recording:
        """Find the moments of a filmed run.

        Raises:
            InvalidValueError: no car was driven, or the episode did not end.
        """
        if film.drive is None:
            raise InvalidValueError("a recording needs a whole episode with a driven car: use control='planner'")
        agent, drive = film.drive.agent, film.drive.drive
        arrived = [film.reached(agent, frame) for frame in range(len(film.arrived))]
        return cls(cell, film, agent, drive, find_moments(drive, film.drive.first_seen, arrived))

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
        news, ids = self.film.news(self.agent, reported), short_ids(drive.ids).tolist()
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
            [(bodies[k, :2], news[ids[k]]) for k in np.flatnonzero(there).tolist() if ids[k] in news],
        )

    def others(self, frame: int) -> dict[str, Floats]:
        """Return the places (2,) m of the other agents in a frame."""
        places = self.film.frames[frame].agents.items()
        return {name: np.array(place[:2]) for name, place in places if name != self.agent}

    def points_at(self, time_s: float) -> Floats:
        """Return the points (P, 2) of the frame at a time."""
        return self._frame_at(time_s).points_m(self.agent)

    def lights_at(self, time_s: float) -> str:
        """Return the states of traffic lights of the frame at a time."""
        return self._frame_at(time_s).lights

    def _frame_at(self, time_s: float) -> FilmFrame:
        return self.film.frames[min(self._place(time_s)[0], len(self.film.frames) - 1)]

    def arrivals(self, time_s: float, within_s: float) -> Iterator[tuple[str, float]]:
        """Yield senders of messages that arrived in the time before, with seconds since then: each one's latest."""
        frame = self._place(time_s)[0]
        met = set[str]()
        for number in range(frame, -1, -1):
            age_s = time_s - float(self.drive.time_s[number])
            if age_s > within_s:
                return
            arrived = self.film.reached(self.agent, number)
            yield from ((sender, max(age_s, 0.0)) for sender in sorted(arrived - met))
            met |= arrived

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
