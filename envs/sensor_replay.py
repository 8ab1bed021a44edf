"""Replay of recordings with sweeps: the same perception, messages and scores as in the simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from coopsim.envs.frames import Frame, FrameProbe, FrameSource
from coopsim.envs.options import PerceptionOptions
from coopsim.envs.simulated.perception import Perception, observation_format
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.se3 import SE3
from coopsim.recordings.recorded_folder import (
    ReadingOptions,
    RecordedAgent,
    RecordedFolder,
    RecordedFrame,
    RecordedSequence,
)
from coopsim.recordings.recorded_scene import RecordedScenes, returns_of
from coopsim.sensors.camera.camera import rig_camera_names
from coopsim.support.checks import require_choice, require_count, require_frame_time
from coopsim.types import AgentSpec, CameraImage, LidarMounting, Sweep, Tracks, seconds_to_ns
from coopsim.types.driving import Command
from coopsim.types.messages import AGENT_KINDS
from coopsim.world.snapshot import RoadMap

LEARNED = "pillars"
"""Name of the detector of replays that are given none; it needs torch."""


@dataclass(frozen=True, slots=True)
class RecordedOptions(PerceptionOptions):
    """Options of a replay of recordings with sweeps.

    Attributes:
        max_cycles: frames of an episode; None: all of the sequence.
        dt_s: time between two frames, a multiple of the recording's; None: the recording's.
        frame_s: time between two recorded frames where the files have no time stamps; None: the format's, 0.1 s.
        lidar_height_m: height of LiDARs over the ground where the files do not say it; a number, or one by kind.
        odometry: "poses" or "auto" (of the files), or "none" (for one agent alone, as if it stood still).
        points: points of KITTI, and of arrays with a `fov_deg`, that are kept: "picture" (those in the labelled view)
            or "all".
        cameras: put the recorded pictures into the observations; the name of a rig, as policies say what they need,
            means the same: a recording has the cameras that it has.

    Simulated detectors are given the labels, and the number of points in each box; errors of poses are added to the
    recorded ones; "visible" objects are those with a point in their box.

    Raises:
        InvalidValueError, UnknownNameError: a value is not accepted.
    """

    max_cycles: int | None = None
    dt_s: float | None = None
    frame_s: float | None = None
    lidar_height_m: float | Mapping[str, float] | None = None
    odometry: str = "auto"
    points: str = "picture"
    cameras: bool | str = False

    def __post_init__(self) -> None:
        if self.max_cycles is not None:
            require_count(1, max_cycles=self.max_cycles)
        if self.dt_s is not None:
            require_frame_time(self.dt_s)
        self.check_scored()
        rig_camera_names(self.cameras)
        self.reading  # noqa: B018  (its own checks run now)
        self.check_perception(LEARNED, lidar=True, cameras=bool(self.cameras))

    @property
    def reading(self) -> ReadingOptions:
        """Choices that the files leave open."""
        return ReadingOptions(self.frame_s, self.lidar_height_m, self.odometry, self.points)


LIDAR = "lidar"
"""Name of an agent's LiDAR, whose points are all that a recording has of the agent, of however many LiDARs."""

MOST_OBJECTS = 1024
"""Rows of `state()`: what a folder's largest number of labels is, only a look at all of them would tell."""

_RANGE_M, _COLUMNS = 200.0, 1800
_WHOLE = 0.01  # share of a recorded frame by which a multiple of its time may be off


class SensorReplay(FrameSource):
    """Frames of a folder of recordings with sweeps; every agent of a sequence is one.

    `reset(seed)` plays the sequence number `seed % len(sequences)`, or `options={"sequence": name}`. All frames are
    scored: after the last one, nothing is observed.

    Agents are named as in the simulation, cars first, in the order of the recording's names: `cav_0`, `cav_1`, ...,
    `rsu_0`. The environment's possible agents are those of the sequence with the most of each kind; an episode has
    those of its sequence, and says in its infos what the recording calls them.

    Raises:
        InvalidValueError: `dt_s` is no multiple of the recordings' time between frames.
        RecordingError: an agent's name is broken; with cameras also: a sequence's first frame.
    """

    road_map = RoadMap((), (), (), ())
    capacity = MOST_OBJECTS

    _sequence: RecordedSequence
    _scenes: RecordedScenes
    _perception: Perception
    _cycle: int

    def __init__(self, name: str, folder: RecordedFolder, options: RecordedOptions) -> None:
        self.name, self.region_m = name, options.region_m
        self._folder, self._options = folder, options
        self._longest = _longest_casts(folder)
        self._every, self._dt_s = _pace(folder.frame_s, options.dt_s)
        self.specs = self._usual_specs()
        self.format = observation_format(self.specs, options, ("rgb",))

    @property
    def sequences(self) -> tuple[str, ...]:
        return self._folder.sequences

    @property
    def reset_options(self) -> tuple[str, ...]:
        return ("sequence",)

    @property
    def episode_infos(self) -> dict[str, Any]:
        """The sequence, and the agents' names in the recording."""
        return {
            "sequence": self._sequence.name,
            "recorded_agents": {name: agent.recorded for name, agent in self._sequence.agents.items()},
        }

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        name = options.get("sequence", self.sequences[seed % len(self.sequences)])
        require_choice("sequence", name, self.sequences)
        sequence = self._folder.open(name)
        scenes = RecordedScenes(sequence, self._every)
        specs = dict(self.specs)
        for agent, seen in scenes.frame(0).agents.items():
            specs[agent] = self._spec(agent, sequence.agents[agent].kind, seen)
        self._sequence, self._scenes, self.specs = sequence, scenes, specs
        self._perception = Perception(self._options, {agent: specs[agent] for agent in sequence.agents}, seed)
        self._cycle = 0
        return self._frame()

    def advance(self, commands: Mapping[str, Command], tracks: Mapping[str, Tracks]) -> Frame:
        self._cycle += 1
        return self._frame()

    @property
    def _frames(self) -> int:
        """Number of frames of the episode that are scored."""
        most = self._options.max_cycles
        return len(self._scenes) if most is None else min(most, len(self._scenes))

    def _frame(self) -> Frame:
        """Return the current frame; after the last one, what was there then, without anything that is sensed."""
        over = self._cycle >= self._frames
        number = min(self._cycle, self._frames - 1)
        frame, bodies, actors = self._scenes.frame(number), self._scenes.bodies(number), self._scenes.actors(number)
        if len(actors) > MOST_OBJECTS:
            raise RecordingError(
                f"{self._folder.path}, sequence {self._sequence.name}, frame {number}: at most {MOST_OBJECTS} objects "
                f"are accepted, got {len(actors)}"
            )
        time_ns = frame.time_ns + (seconds_to_ns(self._dt_s) if over else 0)
        sweeps = {name: {LIDAR: Sweep.empty() if over else agent.read_sweep()} for name, agent in frame.agents.items()}
        images = {name: self._images(name, agent, over=over) for name, agent in frame.agents.items()}
        returns = returns_of(actors, bodies, sweeps)
        agents = self._perception.frames(time_ns, bodies, actors, returns, sweeps, images, sensed=not over)
        end = "recording over" if self._frames == len(self._scenes) else "max_cycles"
        return Frame(time_ns, agents, actors, over, PictureProbe(frame), end)

    def _usual_specs(self) -> dict[str, AgentSpec]:
        """Return the specs of all agents that ever appear; with cameras, from the first frame of a sequence of each."""
        specs: dict[str, AgentSpec] = {}
        for name, sequence in self._longest.items():
            kind = self._folder.agents(sequence)[name].kind
            if self._options.cameras:
                specs[name] = self._spec(name, kind, self._folder.open(sequence).frame(0).agents[name])
            else:
                above_m = self._options.reading.height_m(kind, self._folder.usual_height_m)
                specs[name] = self._spec(name, kind, SE3.from_xyz_yaw([0.0, 0.0, above_m], 0.0))
        return specs

    def _spec(self, name: str, kind: Literal["cav", "rsu", "drone"], seen: RecordedAgent | SE3) -> AgentSpec:
        """Return a spec by an agent's first frame, or by the pose of its LiDAR alone."""
        pose = seen if isinstance(seen, SE3) else seen.base_SE3_lidar
        pictures = seen.find_pictures() if self._options.cameras and isinstance(seen, RecordedAgent) else {}
        return AgentSpec(
            name,
            kind,
            self._dt_s,
            is_object=kind == "cav",
            cameras={camera: picture.calibration for camera, picture in pictures.items()},
            lidars={LIDAR: LidarMounting(pose, _RANGE_M, _COLUMNS, np.zeros(0))},
            calibration=self._options.chosen_detector.calibration,
        )

    def _images(self, name: str, agent: RecordedAgent, *, over: bool) -> dict[str, CameraImage]:
        """Return an agent's pictures; black ones after the last frame."""
        if not self._options.cameras:
            return {}
        sizes = self.format.cameras[name]
        if over:
            return {camera: CameraImage.blank(size, ("rgb",)) for camera, size in sizes.items()}
        pictures = agent.find_pictures()
        for camera, size in sizes.items():
            if camera not in pictures or pictures[camera].calibration.size != size:
                raise RecordingError(
                    f"{self._folder.path}, sequence {self._sequence.name}: {name} must have a picture of {camera} of "
                    f"{size[1]} x {size[0]} pixels in every frame"
                )
        return {camera: CameraImage(pictures[camera].rgb()) for camera in sizes}


class PictureProbe(FrameProbe):
    """The pictures of a frame, read when asked for."""

    def __init__(self, frame: RecordedFrame) -> None:
        self._frame = frame

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        return {
            name: {camera: CameraImage(picture.rgb()) for camera, picture in agent.find_pictures().items()}
            for name, agent in self._frame.agents.items()
        }


def _longest_casts(folder: RecordedFolder) -> dict[str, str]:
    """Return all agents that ever appear, cars first, each with a sequence in which it does."""
    found: dict[str, dict[str, str]] = {kind: {} for kind in AGENT_KINDS}
    for sequence in folder.sequences:
        for name, agent in folder.agents(sequence).items():
            found[agent.kind].setdefault(name, sequence)
    return {name: sequence for named in found.values() for name, sequence in named.items()}


def _pace(frame_s: float, dt_s: float | None) -> tuple[int, float]:
    """Return how many recorded frames lie between two that are shown, plus one, and the time between these, s."""
    every = 1 if dt_s is None else round(dt_s / frame_s)
    if dt_s is not None and (every < 1 or abs(dt_s / frame_s - every) > _WHOLE):
        raise InvalidValueError(f"dt_s must be a multiple of the recordings' {frame_s:g} s, got {dt_s!r}")
    return every, frame_s if dt_s is None else float(dt_s)
