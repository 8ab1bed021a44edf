"""Scenes for wrappers of learners, as an agent sees them: made by hand, so that it is known what must be shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS
from coopsim.envs.wrappers.received import Inbox, Scene
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import AgentSpec, Detections, Message, Observation, Odometry, PoseEstimate, Sweep

SPECS = {name: AgentSpec(name, "cav", 0.1) for name in ("cav_0", "cav_1", "cav_2")}

CAR = (4.0, 2.0, 1.5)


def boxes(*places: Sequence[float], size: Sequence[float] = CAR) -> Boxes3D:
    """Cars at x, y, z, yaw."""
    return Boxes3D.from_array(np.array([[x, y, z, *size, yaw] for x, y, z, yaw in places]).reshape(-1, 7))


def found(*places: Sequence[float], score: Sequence[float] = (), label: int = 0) -> Detections:
    scores = np.asarray(score if len(score) else [0.5] * len(places))
    return Detections(boxes(*places), scores, np.full(len(places), label))


def message(
    sender: str, pose: Sequence[float], content: Any, *, captured_ns: int = 0, codec: str = "detections"
) -> Message:
    payload = CODECS.get(codec)().encode(content)
    return Message(sender, captured_ns, PoseEstimate(np.array(pose)), payload, codec)


def scene(
    detections: Detections | None = None,
    inbox: Sequence[Message] = (),
    *,
    pose: Sequence[float] = (0, 0, 0, 0),
    time_ns: int = 0,
    points: Any = None,
) -> Scene:
    """What `cav_0` knows in its first frame."""
    sweeps = {}
    if points is not None:
        xyz = np.asarray(points, np.float32).reshape(-1, 3)
        sweeps["top"] = Sweep(xyz, np.full(len(xyz), 0.5, np.float32), np.zeros(len(xyz), np.int64))
    observation = Observation(
        time_ns,
        PoseEstimate(np.array(pose)),
        Odometry(np.zeros(4)),
        Detections.empty() if detections is None else detections,
        sweeps,
        inbox=tuple(inbox),
    )
    reader = Inbox(SPECS)
    reader.follow("cav_0", observation)
    return Scene(observation, reader, "cav_0")
