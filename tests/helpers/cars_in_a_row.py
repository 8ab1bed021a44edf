"""Cars along x, observations and messages of them, for rankings of what is said."""

from __future__ import annotations

import numpy as np

from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate


def boxes(x: list[float], score: float = 0.5) -> Detections:
    rows = np.array([[each, 0.0, 0.8, 4.5, 1.9, 1.6, 0.0] for each in x]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(rows), np.full(len(x), score), np.zeros(len(x), dtype=int))


def observe(found: Detections, *inbox: Message, x: float = 0.0, yaw: float = 0.0) -> Observation:
    return Observation(0, PoseEstimate(np.array([x, 0.0, 0.0, yaw])), Odometry(np.zeros(4)), found, inbox=inbox)


def message(sender: str, found: Detections, x: float = 0.0, yaw: float = 0.0) -> Message:
    sent = ShareDetections().message(sender, observe(found, x=x, yaw=yaw))
    assert sent is not None
    return sent
