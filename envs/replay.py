"""The replay source: real recorded detections through the same interface as the simulation.

Recordings have no poses, so the recording's own frame (the ego car's, at each moment) is the world frame, the
base frame and the odometry frame of every agent at once. Which way the car looks in it is the files' matter: along x by
KITTI's axes, along -y in V2V4Real's files, which name theirs the same but drive along x.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.recording_set import Recording, RecordingSet
from coopsim.envs.frames import AgentFrame, Frame, FrameSource
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.support.checks import require_choice
from coopsim.types import AgentSpec, Detections, GroundTruth, Observation, Odometry, PoseEstimate, seconds_to_ns
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

_NOWHERE = np.zeros(4)
_GREY = (128, 128, 128)


class Replay(FrameSource):
    """Frames of a recording set; every detection name is one agent.

    `reset` plays the set's first sequence, or `options={"sequence": name}`. All frames are scored: the
    observation after the last one is empty.

    Args:
        name: the environment's id.
        path: a folder with `labels/<sequence>.txt` and `detections/<name>/<sequence>.txt`.
        detections: the names to play; they name the agents, and the first is the one whose frame the recording is in.
            A text is one name.
        dt_s: time between two frames.

    Raises:
        InvalidValueError: the path or the detections are missing, or a name of detections is given twice.
        UnknownNameError: there are no detections of that name.
        RecordingError: the folder is no recording set, or a label file is broken.
    """

    region_m = None
    road_map = RoadMap((), (), (), ())

    _recording: Recording
    _cycle: int

    def __init__(
        self,
        name: str,
        path: str | Path | None,
        detections: Sequence[str] | None,
        dt_s: float,
    ) -> None:
        self.name = name
        self._set = RecordingSet(path)
        agents = self._set.require_detections(detections)
        if not agents:
            accepted = ", ".join(self._set.detection_names)
            raise InvalidValueError(f"detections must be at least one name, got {detections!r}; accepted: {accepted}")
        self.specs = {agent: AgentSpec(agent, "cav", dt_s, is_object=False, frame_owner=agents[0]) for agent in agents}
        self._bodies = {agent: AgentBody(agent, "cav", None, SE3.identity(), 0.0) for agent in agents}
        self.format = ObservationFormat(agents)
        self._dt_s = dt_s
        self.capacity = self._set.most_objects()

    @property
    def sequences(self) -> tuple[str, ...]:
        return self._set.sequences

    @property
    def reset_options(self) -> tuple[str, ...]:
        return ("sequence",)

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        sequence = options.get("sequence", self.sequences[0])
        require_choice("sequence", sequence, self.sequences)
        self._recording = self._set.load(sequence, tuple(self.specs))
        self._cycle = 0
        return self._frame()

    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        self._cycle += 1
        return self._frame()

    def _frame(self) -> Frame:
        """The current frame; after the recording's end, one in which nothing is observed or true."""
        over = self._cycle >= self._recording.frames
        truth = GroundTruth.empty() if over else self._recording.truth[self._cycle]
        time_ns = seconds_to_ns(self._cycle * self._dt_s)
        agents = {
            name: AgentFrame(
                Observation(
                    time_ns,
                    PoseEstimate(_NOWHERE),
                    Odometry(_NOWHERE),
                    Detections.empty() if over else self._recording.detections[name][self._cycle],
                ),
                self._bodies[name],
                truth,
            )
            for name in self.specs
        }
        return Frame(time_ns, agents, _as_actors(truth), last=over)


def _as_actors(truth: GroundTruth) -> Actors:
    count = len(truth)
    return Actors(
        truth.id,
        truth.boxes,
        np.zeros((count, 2)),
        truth.label,
        np.zeros(count, dtype=np.int64),
        np.tile(np.array(_GREY, dtype=np.uint8), (count, 1)),
    )
