"""The replay source: recorded detections through the same interface as the simulation.

A recording is in the frame of one car, the owner, at each moment: this is the base frame of every agent. How the owner
moved is read from poses or estimated from its detections (see `RecordingSet.motions`). The world frame is where it was
in the first frame; the pose estimate of every agent is the sum of that motion, so a delayed message's boxes are placed
where they were, and standing objects stand still in the odometry frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.recording_set import ODOMETRY, Recording, RecordingSet
from coopsim.envs.frames import AgentFrame, Frame, FrameSource
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.support.checks import require_choice, require_frame_time
from coopsim.types import (
    AgentSpec,
    Detections,
    GroundTruth,
    Observation,
    Odometry,
    PoseEstimate,
    Tracks,
    seconds_to_ns,
    stack_xyz_yaw,
)
from coopsim.types.driving import Command
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

_GREY = (128, 128, 128)


@dataclass(frozen=True, slots=True)
class TextOptions:
    """Options of a replay of detections in text files.

    Attributes:
        detections: names under `detections/`; each is one agent. There is no default.
        dt_s: time between two frames.
        odometry: source of the recording car's motion: "poses" of the set, "estimated" from the detections, "auto"
            (poses where there are any), or "none": as if it stood still.
        axes: convention of the files' axes: "kitti", or "v2v4real" for headings that models of driving can use.
    """

    detections: Sequence[str] | None = None
    dt_s: float = 0.1
    odometry: str = "auto"
    axes: str = "kitti"

    def __post_init__(self) -> None:
        require_frame_time(self.dt_s)


class Replay(FrameSource):
    """Frames of a recording set; every name of detections is one agent.

    `reset` plays the set's first sequence, or `options={"sequence": name}`. All frames are scored: the
    observation after the last one is empty.

    Args:
        name: the environment's id.
        path: a folder with `labels/<sequence>.txt` and `detections/<name>/<sequence>.txt`.
        detections: the names to play; they name the agents, and the first is the one whose frame the recording is in.
            A text is one name.
        dt_s: time between two frames.
        odometry: source of the owner's motion: "auto", "poses", "estimated" or "none" (as if it stood still).
        axes: convention of the files' axes: "kitti" or "v2v4real", see `coopsim.data.kitti`.

    Raises:
        InvalidValueError: the path or the detections are missing, or a name of detections is given twice.
        UnknownNameError: there are no detections, no odometry or no axes of that name.
        RecordingError: the folder is no recording set, or a label file is broken.
    """

    region_m = None
    any_score = True
    road_map = RoadMap((), (), (), ())

    _recording: Recording
    _moved: list[SE3]
    _world_SE3_base: SE3
    _cycle: int

    def __init__(
        self,
        name: str,
        path: str | Path | None,
        detections: Sequence[str] | None,
        dt_s: float,
        odometry: str = "auto",
        axes: str = "kitti",
    ) -> None:
        self.name = name
        require_choice("odometry", odometry, ODOMETRY)
        self._odometry = odometry
        self._set = RecordingSet(path, axes)
        agents = self._set.require_detections(detections)
        if not agents:
            accepted = ", ".join(self._set.detection_names)
            raise InvalidValueError(f"detections must be at least one name, got {detections!r}; accepted: {accepted}")
        self.specs = {agent: AgentSpec(agent, "cav", dt_s, is_object=False, frame_owner=agents[0]) for agent in agents}
        self.format = ObservationFormat(agents)
        self._dt_s = dt_s
        self.capacity = self._set.most_objects()
        self._motions: dict[str, list[SE3]] = {}

    @property
    def sequences(self) -> tuple[str, ...]:
        return self._set.sequences

    @property
    def reset_options(self) -> tuple[str, ...]:
        return ("sequence",)

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        sequence = options.get("sequence", self.sequences[0])
        require_choice("sequence", sequence, self.sequences)
        recording = self._set.load(sequence, tuple(self.specs))
        if sequence not in self._motions:
            owner = next(iter(self.specs))
            motions = self._set.motions(sequence, recording, owner, self._dt_s, self._odometry)
            self._motions[sequence] = [*motions, SE3.identity()]
        self._recording, self._moved, self._cycle = recording, self._motions[sequence], 0
        self._world_SE3_base = SE3.identity()
        return self._frame()

    def advance(self, commands: Mapping[str, Command], tracks: Mapping[str, Tracks]) -> Frame:
        self._cycle += 1
        self._world_SE3_base = self._world_SE3_base.compose(self._moved[self._cycle])
        return self._frame()

    def _frame(self) -> Frame:
        """Return the current frame; after the recording's end, one in which nothing is observed or true."""
        over = self._cycle >= self._recording.frames
        truth = GroundTruth.empty() if over else self._recording.truth[self._cycle]
        time_ns = seconds_to_ns(self._cycle * self._dt_s)
        world_SE3_base = self._world_SE3_base
        pose, odometry = PoseEstimate(stack_xyz_yaw(world_SE3_base)), Odometry(stack_xyz_yaw(self._moved[self._cycle]))
        agents = {
            name: AgentFrame(
                Observation(
                    time_ns,
                    pose,
                    odometry,
                    Detections.empty() if over else self._recording.detections[name][self._cycle],
                ),
                AgentBody(name, "cav", None, world_SE3_base, 0.0),
                truth,
            )
            for name in self.specs
        }
        return Frame(time_ns, agents, _as_actors(truth, world_SE3_base), over, end="recording over")


def _as_actors(truth: GroundTruth, world_SE3_base: SE3) -> Actors:
    count = len(truth)
    return Actors(
        truth.id,
        truth.boxes.transform(world_SE3_base),
        np.zeros((count, 2)),
        truth.label,
        np.zeros(count, dtype=np.int64),
        np.tile(np.array(_GREY, dtype=np.uint8), (count, 1)),
    )
