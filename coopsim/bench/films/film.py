"""The film of a run: its frames from above, as small integers, and the drive of its car."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.films.space import Solid, SpaceFrame
from coopsim.bench.films.space_filming import SpaceFilming, seen_in
from coopsim.episode import Episode, Recorder
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

POINTS, CAR_POINTS = 500, 700
"""Points that a frame keeps of all agents together or of one, and of a driven car."""

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
    """

    time_ns: int
    agents: Mapping[str, Place]
    truth: Rows
    points: Mapping[str, NDArray[np.int16]] = field(default_factory=dict)
    tracks: Mapping[str, Rows] = field(default_factory=dict)
    lies: Sequence[ShownLie] = ()
    lights: str = ""
    space: SpaceFrame | None = None

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
    scaled = np.column_stack([ids % (_INT32_MAX + 1), prints[:, :4] / BOX_M, wrap_angle(prints[:, 4]) / TURN_RAD])
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


class Filming(Recorder):
    """Films a run: points of all agents together, or where cars are driven those of each, with its messages and drive.

    Args:
        points: number of points of a frame; 0: none.
        of_each: film the points and messages of each agent, too.
        space: number of points of each agent in three dimensions; 0: boxes alone; None: the film is from above alone.
    """

    def __init__(self, points: int = POINTS, *, of_each: bool = False, space: int | None = None) -> None:
        self._points, self._of_each, self._cloud = points, of_each, space
        self.frames: list[FilmFrame] = []
        self._arrived: list[Mapping[str, frozenset[str]]] = []
        self._delivered: dict[tuple[str, str], int] = {}
        self._drive: FilmedDrive | None = None
        self._dt_s, self._map = 0.0, RoadMap((), (), (), ())
        self._space: SpaceFilming | None = None
        self._logs: Mapping[str, TrackLog] = {}

    def begin(self, episode: Episode) -> None:
        env = episode.env
        self._cars = list(env.cars)
        self._receivers = self._cars or (list(episode.frame.agents) if self._of_each else [])
        self._dt_s, self._map = next(iter(env.agent_specs.values())).dt_s, env.road_map
        self._space = None if self._cloud is None else SpaceFilming(env, self._cloud)
        self._hear = self._receivers if self._space is None else list(episode.frame.agents)

    def on_step(self, episode: Episode) -> None:
        env = episode.env
        clouds = dict.fromkeys(self._receivers, CAR_POINTS if self._cars else self._points)
        clouds |= {} if self._cars else {ALL: self._points}
        points = {
            name: thinned(env.bev_frame(agent=name or None).points, count) for name, count in clouds.items() if count
        }
        shown = FilmFrame.of(env.bev_frame(points=False), points)
        space = None if self._space is None else self._space.frame(env)
        self.frames.append(replace(shown, lights=env.road_map.lights, space=space))
        self._logs = env.logs
        self._note_arrivals({link: each.delivered for link, each in env.link_counts.items()})
        if self._cars and not env.agents:
            self._drive = FilmedDrive.of(self._cars[0], env.records["drives"][self._cars[0]].drive, env.logs)

    def _note_arrivals(self, delivered: dict[tuple[str, str], int]) -> None:
        if not self._arrived:  # the first call comes after two frames, and each has one message of a sender
            self._arrived.append(self._senders(link for link, count in delivered.items() if count > 1))
        new = (link for link, count in delivered.items() if count > self._delivered.get(link, 0))
        self._arrived.append(self._senders(new))
        self._delivered = delivered

    def _senders(self, links: Iterable[tuple[str, str]]) -> dict[str, frozenset[str]]:
        found = dict[str, list[str]]()
        for sender, receiver in links:
            found.setdefault(receiver, []).append(sender)
        return {name: frozenset(found[name]) for name in self._hear if name in found}

    @property
    def film(self) -> Film:
        """The film so far."""
        frames, solids = self.frames, tuple[Solid, ...]()
        if self._space is not None and frames:
            spaces = [each.space for each in frames if each.space is not None]
            known = zip(spaces, seen_in(self._logs, len(frames)), strict=True)
            spaces = [replace(space, seen=seen) for space, seen in known]
            frames = [replace(frame, space=space) for frame, space in zip(frames, spaces, strict=True)]
            solids = self._space.solids(spaces)
        return Film(self._dt_s, self._map, frames, self._arrived, self._drive, solids)


def thinned(points: Floats, count: int) -> Floats:
    """Return about `count` of the points (N, 3): every n-th in the order of the sweep, which runs around the sensor."""
    stride = max(1, -(-len(points) // count))
    return points[::stride]
