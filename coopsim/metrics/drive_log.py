"""The log of a drive: what a driven car did, what was around it, and what its policy reported, frame by frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.episode import Episode, Recorder
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.metrics.drive_rules import RuleState, state_of
from coopsim.support.arrays import freeze
from coopsim.types import NS_PER_S, GroundTruth, Ints, Mask, Tracks, stack_xyz_yaw
from coopsim.types.driving import CarState
from coopsim.world.drivable_area import DrivableArea

_Small = NDArray[np.float32]
"""Places in a car's own frame are kept with 32 bits, which are exact to 0.01 mm at 100 m."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveFrame:
    """A driven car in one frame.

    Attributes:
        time_ns: time since the episode's start.
        pose: (3,) x and y, m, of the car's middle, and its heading, rad; true, in the world frame.
        car: state of the car.
        truth: all objects but the car itself, in the car's base frame, with velocities.
        tracks: tracks that were reported for the frame, in the car's base frame.
        command_m_s2: acceleration that the planner or the agent asked for; NaN for none.
        conflict_ids: ids of the objects that the situation's script sends into the car's way.
        left: whether its middle is on no road, and whether it has left the drivable area.
    """

    time_ns: int
    pose: Floats
    car: CarState
    truth: GroundTruth
    tracks: Tracks
    command_m_s2: float = math.nan
    conflict_ids: tuple[int, ...] = ()
    left: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        freeze(self, pose=((3,), np.float64))
        if self.truth.velocity is None and len(self.truth):
            raise InvalidValueError("the truth of a drive must have velocities, got none")


class DriveLog:
    """The log of one drive, which grows frame by frame: about 5 kB per frame with 50 objects."""

    def __init__(self) -> None:
        self._frames: list[_Packed] = []
        self._size_m = (0.0, 0.0)
        self._drive: Drive | None = None

    def __len__(self) -> int:
        return len(self._frames)

    def append(self, frame: DriveFrame) -> None:
        """Add a frame.

        Raises:
            InvalidValueError: it is not later than the frame before.
        """
        if self._frames and frame.time_ns <= self._frames[-1].time_ns:
            raise InvalidValueError(
                f"a frame of a drive must be later than the one before, got {frame.time_ns} ns after "
                f"{self._frames[-1].time_ns} ns"
            )
        self._frames.append(_Packed.of(frame))
        self._size_m = frame.car.length_m, frame.car.width_m
        self._drive = None

    @property
    def drive(self) -> Drive:
        """All frames so far, as arrays over time.

        Raises:
            InvalidValueError: the log is empty.
        """
        if not self._frames:
            raise InvalidValueError("a drive must have at least one frame, got an empty log")
        if self._drive is None:
            self._drive = _unpacked(self._frames, self._size_m)
        return self._drive


class DriveRecorder(Recorder):
    """Logs of the drives, by the agents whose cars a planner or the action drives."""

    def begin(self, episode: Episode) -> None:
        self._logs = {name: DriveLog() for name, agent in episode.frame.agents.items() if agent.car is not None}
        self._driven: dict[str, DriveFrame] = {}
        cars = [episode.frame.agents[name].car for name in self._logs]
        steered = any(car is not None and car.wheelbase_m > 0 for car in cars)
        self._area = DrivableArea(episode.env.road_map) if steered else None

    def on_report(self, episode: Episode) -> None:
        self._driven = {name: self._frame(episode, name, episode.tracks[name]) for name in self._logs}

    def on_step(self, episode: Episode) -> None:
        frame = episode.frame
        for name, log in self._logs.items():
            log.append(replace(self._driven[name], command_m_s2=frame.agents[name].command_m_s2))
            if frame.last:
                log.append(self._frame(episode, name, Tracks.empty()))

    def records(self) -> dict[str, DriveLog]:
        return {name: log for name, log in self._logs.items() if len(log)}

    def _frame(self, episode: Episode, name: str, tracks: Tracks) -> DriveFrame:
        """Return a driven car in the newest frame, with tracks in its base frame."""
        agent, conflicts = episode.frame.agents[name], episode.facts.get("conflicts", ())
        car, pose = agent.car, stack_xyz_yaw(agent.body.world_SE3_base)[[0, 1, 3]]
        assert car is not None
        left = (False, False) if self._area is None else self._area.left(pose, car.length_m, car.width_m)
        return DriveFrame(episode.frame.time_ns, pose, car, agent.truth, tracks, conflict_ids=conflicts, left=left)


class WayAhead(NamedTuple):
    """The way ahead of the car in one frame.

    Attributes:
        points: (K, 2) m in the world frame.
        spacing_m: distance from each point to the next.
        speed_limit_m_s: (K,).
    """

    points: Floats
    spacing_m: float
    speed_limit_m_s: Floats


class ReportedTracks(NamedTuple):
    """The tracks of one frame.

    Attributes:
        boxes: (M, 5) x, y, length, width, m, and yaw, rad, in the world frame.
        label: (M,) an `ObjectClass`.
    """

    boxes: Floats
    label: Ints


# Without slots, so that results can be kept with it.
@dataclass(frozen=True, eq=False)
class Drive:
    """A drive of F frames with A objects, in the world frame.

    Attributes:
        time_s: (F,) from the episode's start.
        car: (F, 5) the car's body: x, y, length, width, m, and yaw, rad.
        speed_m_s: (F,) along its heading.
        acceleration_m_s2: (F,) along its heading.
        command_m_s2: (F,) NaN where nothing was asked for.
        crashed: (F,) whether it has touched something.
        ids: (A,) ids of the objects, rising.
        label: (A,) an `ObjectClass`.
        in_conflict: (A,) whether the situation's script sends the object into the car's way.
        boxes: (F, A, 5) bodies as `car`; NaN where an object is absent.
        velocity: (F, A, 2) m/s; NaN where an object is absent.
        seen_by: (F, A) index into `coopsim.metrics.score.SEEN_BY`; -1 where unknown or absent.
        tracks: reported tracks of each frame.
        ways: way ahead in each frame.
        hit_by_log: see `CarState`.
        rules: (F, 6) what each frame says of the rules of the road, see `RuleState`; empty: unknown.
    """

    time_s: Floats
    car: Floats
    speed_m_s: Floats
    acceleration_m_s2: Floats
    command_m_s2: Floats
    crashed: Mask
    ids: Ints
    label: Ints
    in_conflict: Mask
    boxes: Floats
    velocity: Floats
    seen_by: Ints
    tracks: tuple[ReportedTracks, ...]
    ways: tuple[WayAhead, ...]
    hit_by_log: bool = False
    rules: Floats = field(default_factory=lambda: np.zeros((0, len(RuleState._fields))))

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def velocity_m_s(self) -> Floats:
        """Velocity (F, 2) of the car over ground."""
        heading = np.column_stack([np.cos(self.car[:, 4]), np.sin(self.car[:, 4])])
        velocity: Floats = self.speed_m_s[:, None] * heading
        return velocity


class _Packed(NamedTuple):
    time_ns: int
    pose: Floats
    state: tuple[float, float, float, bool, bool]  # speed, acceleration, command, whether crashed, and hit by a log
    spacing_m: float
    route: _Small  # (K, 3): x, y, speed limit
    ids: Ints
    label: NDArray[np.int8]
    seen_by: NDArray[np.int8]
    truth: _Small  # (N, 7): x, y, length, width, yaw, vx, vy
    track_label: NDArray[np.int8]
    tracks: _Small  # (M, 5)
    conflict_ids: tuple[int, ...]
    rules: RuleState

    @classmethod
    def of(cls, frame: DriveFrame) -> _Packed:
        car, truth, tracks = frame.car, frame.truth, frame.tracks
        objects = np.zeros((len(truth), 7), np.float32)
        _fill(objects, truth.boxes)
        if truth.velocity is not None:
            objects[:, 5:] = truth.velocity
        reported = np.empty((len(tracks), 5), np.float32)
        _fill(reported, tracks.boxes)
        route = np.empty((len(car.route.points), 3), np.float32)
        route[:, :2], route[:, 2] = car.route.points, car.route.speed_limit_m_s
        seen_by = np.full(len(truth), -1, np.int8) if truth.visible_to is None else truth.visible_to.astype(np.int8)
        return cls(
            frame.time_ns,
            frame.pose,
            (car.speed_m_s, car.acceleration_m_s2, frame.command_m_s2, car.crashed, car.hit_by_log),
            car.route.spacing_m,
            route,
            truth.id,
            truth.label.astype(np.int8),
            seen_by,
            objects,
            tracks.label.astype(np.int8),
            reported,
            frame.conflict_ids,
            state_of(car, *frame.left, scripted=bool(frame.conflict_ids)),
        )


def _fill(rows: _Small, boxes: Boxes3D) -> None:
    rows[:, :2], rows[:, 2:4], rows[:, 4] = boxes.center[:, :2], boxes.size[:, :2], boxes.yaw


def _unpacked(frames: list[_Packed], size_m: tuple[float, float]) -> Drive:
    """Return the drive of packed frames and a car of this length and width."""
    state = np.array([frame.state for frame in frames])
    pose = np.array([frame.pose for frame in frames])
    size = np.broadcast_to(size_m, (len(frames), 2))
    ids, column = np.unique(np.concatenate([frame.ids for frame in frames]), return_inverse=True)
    row = np.repeat(np.arange(len(frames)), [len(frame.ids) for frame in frames])
    boxes, velocity = np.full((len(frames), len(ids), 5), np.nan), np.full((len(frames), len(ids), 2), np.nan)
    seen_by, label = np.full((len(frames), len(ids)), -1), np.zeros(len(ids), np.int64)
    objects = np.concatenate([frame.truth for frame in frames]).astype(np.float64)
    boxes[row, column] = _placed(objects[:, :5], pose[row])
    velocity[row, column] = _turned(objects[:, 5:], pose[row, 2])
    seen_by[row, column] = np.concatenate([frame.seen_by for frame in frames])
    label[column] = np.concatenate([frame.label for frame in frames])
    return Drive(
        np.array([frame.time_ns for frame in frames]) / NS_PER_S,
        np.column_stack([pose[:, :2], size, pose[:, 2]]),
        state[:, 0],
        state[:, 1],
        state[:, 2],
        state[:, 3] > 0,
        ids,
        label,
        np.isin(ids, sorted({each for frame in frames for each in frame.conflict_ids})),
        boxes,
        velocity,
        seen_by,
        tuple(_tracks(frame) for frame in frames),
        tuple(_way(frame) for frame in frames),
        bool(state[-1, 4]),
        np.array([frame.rules for frame in frames], dtype=np.float64),
    )


def _tracks(frame: _Packed) -> ReportedTracks:
    return ReportedTracks(_placed(frame.tracks.astype(np.float64), frame.pose), frame.track_label.astype(np.int64))


def _way(frame: _Packed) -> WayAhead:
    route = frame.route.astype(np.float64)
    return WayAhead(_turned(route[:, :2], frame.pose[2]) + frame.pose[:2], frame.spacing_m, route[:, 2])


def _turned(vectors: Floats, angle: Floats | float) -> Floats:
    """Return vectors (N, 2) turned by angles (N,) or one angle, rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([vectors[:, 0] * cos - vectors[:, 1] * sin, vectors[:, 0] * sin + vectors[:, 1] * cos])


def _placed(rows: Floats, pose: Floats) -> Floats:
    """Return bodies (N, 5) moved from the car's frame to the world, by one pose (3,) or each by its own (N, 3)."""
    at, heading = pose[..., :2], pose[..., 2]
    return np.column_stack([_turned(rows[:, :2], heading) + at, rows[:, 2:4], rows[:, 4] + heading])
