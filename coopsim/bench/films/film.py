"""The film of a run: its frames from above, as small integers, and the drive of its car."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.films.space import Solid, SpaceFrame, short_ids
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.metrics.drive_events import find_events
from coopsim.metrics.drive_log import Drive
from coopsim.metrics.score import SEEN_BY
from coopsim.metrics.track_log import TrackLog
from coopsim.types import Ints
from coopsim.viz.bev import BevFrame, footprints
from coopsim.world.snapshot import AgentBody, RoadMap

BOX_M, POINT_M, TURN_RAD = 0.01, 0.05, 1e-4
"""Units of the integers that store boxes, points and headings."""

ALL = ""
"""Name of the points of all agents together."""

NEWS_S = 0.8
"""Time for which pictures mark what a message has just told of."""

_INT16_MAX, _INT32_MAX = 2**15 - 1, 2**31 - 1
_BY_ITSELF = SEEN_BY.index("me")

Rows = NDArray[np.int32]
"""Boxes (N, 6): id, x, y, length, width, in the world frame, and yaw."""


class Place(NamedTuple):
    """Place of an agent, m in the world frame, and whether it rides on an actor."""

    x: float
    y: float
    rides: bool

    @classmethod
    def of(cls, body: AgentBody) -> Place:
        """Return the place of an agent's body."""
        x, y = body.world_SE3_base.translation[:2].tolist()
        return cls(x, y, body.actor_id is not None)


class ShownLie(NamedTuple):
    """Lies of an agent in one frame: boxes that it claims and denies, and the place that it states, m."""

    agent: str
    claimed: Rows
    denied: Rows
    stated_m: tuple[float, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class FilmFrame:
    """Content of a picture from above, in the world frame.

    Attributes:
        time_ns: time since the episode's start.
        agents: places by agent.
        truth: all actors.
        points: (P, 2) `POINT_M` from the agents' `middle`, however far they have driven: of `ALL`, or by agent.
        tracks: tracks by the agent that reported them.
        lies: lies in the messages of the frame.
        lights: states of traffic lights, see `RoadMap`.
        space: the frame in three dimensions; None: it was filmed from above alone.
        told: ids of the objects that an agent knows by messages alone, see `coopsim.bench.films.told`.
    """

    time_ns: int
    agents: Mapping[str, Place]
    truth: Rows
    points: Mapping[str, NDArray[np.int16]] = field(default_factory=dict)
    tracks: Mapping[str, Rows] = field(default_factory=dict)
    lies: Sequence[ShownLie] = ()
    lights: str = ""
    space: SpaceFrame | None = None
    told: Mapping[str, Ints] = field(default_factory=dict)

    @classmethod
    def of(cls, frame: BevFrame, points: Mapping[str, Floats] | None = None) -> FilmFrame:
        """Take over a frame, with points (N, 2 or more) m in the world frame by agent."""
        made = cls(
            frame.time_ns,
            {name: Place.of(body) for name, body in frame.agents.items()},
            to_rows(frame.actors.id, footprints(frame.actors.boxes)),
            tracks={name: to_rows(each.id, footprints(each.boxes)) for name, each in frame.tracks.items()},
            lies=[
                ShownLie(lie.agent, _numbered(lie.claimed), _numbered(lie.denied), lie.stated_m) for lie in frame.lies
            ],
        )
        return replace(made, points={name: _near(each, made.middle) for name, each in (points or {}).items()})

    @property
    def middle(self) -> Floats:
        """The middle (2,) of the agents, in whole m."""
        middle: Floats = np.mean([each[:2] for each in self.agents.values()] or [(0.0, 0.0)], axis=0)
        return middle.round()

    def points_m(self, agent: str) -> Floats:
        """Return the points (P, 2) of an agent, m in the world frame."""
        return self.points[agent] * POINT_M + self.middle if agent in self.points else np.zeros((0, 2))


def to_rows(ids: Ints, prints: Floats) -> Rows:
    """Return boxes with footprints (N, 5), m and rad, as whole numbers."""
    scaled = np.column_stack([short_ids(ids), prints[:, :4] / BOX_M, wrap_angle(prints[:, 4]) / TURN_RAD])
    return np.clip(np.round(scaled), -_INT32_MAX, _INT32_MAX).astype(np.int32)


def boxes_of(rows: Rows) -> Boxes3D:
    """Return rows as boxes of 1 m height on the ground."""
    lengths, flat = rows[:, 1:5] * BOX_M, np.zeros(len(rows))
    return Boxes3D.from_array(np.column_stack([lengths[:, :2], flat, lengths[:, 2:], flat + 1, rows[:, 5] * TURN_RAD]))


def _numbered(boxes: Boxes3D) -> Rows:
    return to_rows(np.arange(len(boxes)), footprints(boxes))


def _near(points: Floats, middle: Floats) -> NDArray[np.int16]:
    scaled = np.round((points[:, :2] - middle) / POINT_M)
    return scaled[(np.abs(scaled) <= _INT16_MAX).all(axis=1)].astype(np.int16)


@dataclass(frozen=True, slots=True, eq=False)
class FilmedDrive:
    """The drive of a car in a film.

    Attributes:
        agent: name of the driven car.
        drive: the drive; what it crashed into is in conflict where no script names another.
        first_seen: first frame in which the sensors of each other agent saw what the car must not touch; agents that
            never did are left out.
    """

    agent: str
    drive: Drive
    first_seen: Mapping[str, int]

    @classmethod
    def of(cls, agent: str, drive: Drive, logs: Mapping[str, TrackLog]) -> FilmedDrive:
        """Take over a drive, with the logs of all agents."""
        crash = None if drive.in_conflict.any() else find_events(drive).crash
        drive = drive if crash is None else replace(drive, in_conflict=drive.ids == crash.object_id)
        seen = {name: _first_seen(log, drive) for name, log in logs.items() if name != agent}
        return cls(agent, drive, {name: frame for name, frame in seen.items() if frame is not None})


def _first_seen(log: TrackLog, drive: Drive) -> int | None:
    """Return the first frame in which an agent's own sensors saw what the car must not touch; None: it never did."""
    flat = log.flat()
    seen = np.isin(flat.truth_id, drive.ids[drive.in_conflict]) & (flat.truth_seen_by == _BY_ITSELF)
    rows = np.flatnonzero(seen)
    return int(np.searchsorted(flat.truth_start, rows[0], side="right") - 1) if len(rows) else None


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """A run from above.

    Attributes:
        dt_s: time between frames.
        road_map: outlines of the place.
        frames: F frames.
        arrived: senders of messages that reached each receiver, of F + 1 frames.
        drive: drive of a car; None: none was driven, or the episode did not end.
        solids: meshes of the place, where the frames are in three dimensions.
    """

    dt_s: float
    road_map: RoadMap
    frames: Sequence[FilmFrame]
    arrived: Sequence[Mapping[str, frozenset[str]]] = ()
    drive: FilmedDrive | None = None
    solids: Sequence[Solid] = ()

    def reached(self, receiver: str, frame: int) -> frozenset[str]:
        """Return the senders whose messages reached a receiver in a frame."""
        return self.arrived[frame].get(receiver, frozenset())

    def news(self, agent: str, frame: int) -> dict[int, float]:
        """Return what messages have just told an agent of: the ids, each with the share of `NEWS_S` since then."""
        shown = max(1, round(NEWS_S / self.dt_s))
        told = [self._told(agent, k) for k in range(frame, max(frame - shown, 0) - 1, -1)]
        told += [set()] * (frame < shown)  # of the time before the film
        ages = {each: next((k for k, ids in enumerate(told) if each not in ids), None) for each in sorted(told[0])}
        return {each: (age - 1) / shown for each, age in ages.items() if age is not None}

    def _told(self, agent: str, frame: int) -> set[int]:
        ids = self.frames[frame].told.get(agent)
        return set() if ids is None else {*ids.tolist()}
