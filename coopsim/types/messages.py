"""What goes in and out of a policy: messages, observations, and what is known of an agent beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from coopsim.errors import InvalidValueError
from coopsim.types.estimates import Detections
from coopsim.types.sensing import CameraCalibration, CameraImage, Odometry, PoseEstimate, Sweep


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """What one agent broadcast.

    Attributes:
        sender: the agent's name, which is not empty.
        captured_ns: when the content was sensed (not when it was sent or arrived).
        pose: the sender's estimate of its own pose at that time.
        payload: the encoded content.
        codec: the name of the codec that encoded it.
    """

    sender: str
    captured_ns: int
    pose: PoseEstimate
    payload: bytes
    codec: str

    def __post_init__(self) -> None:
        if not self.sender:
            raise InvalidValueError("sender must be an agent's name, got ''")


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What one agent knows in one frame; everything but the inbox is in its own base frame, now.

    Attributes:
        time_ns: now.
        pose: the global pose estimate.
        odometry: motion since the last observation.
        detections: the agent's own detections.
        sweeps: by sensor name.
        cameras: by sensor name; empty when cameras are off.
        inbox: messages that arrived since the last observation, oldest capture first.
    """

    time_ns: int
    pose: PoseEstimate
    odometry: Odometry
    detections: Detections
    sweeps: Mapping[str, Sweep] = field(default_factory=dict)
    cameras: Mapping[str, CameraImage] = field(default_factory=dict)
    inbox: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class AgentSpec:
    """What a policy may know of an agent before the first frame.

    Attributes:
        name: as `cav_0`, `rsu_0` or `drone_0`.
        kind: "cav" (drives), "rsu" (stands) or "drone" (flies; its base frame is on the ground under it).
        dt_s: time between two observations.
        uplink: what the environment lets agents broadcast ("none", "detections", "tracks").
        drives: the action must say how to drive (`control="policy"`, connected cars only).
        is_object: others see it over the origin of its base frame, but it is not its own object. Not so for a mast, nor
            for a recording, which does not say where its agents are.
        frame_owner: whose base frame all agents' boxes are in, where that is one agent's, as in a recording; None: each
            agent's are in its own.
        cameras: of each of its cameras, by name; of the running episode, as cars are of different heights.
        codec: by which codec agents encode what they broadcast; None: by the one with the uplink's name.
    """

    name: str
    kind: Literal["cav", "rsu", "drone"]
    dt_s: float
    uplink: str
    drives: bool = False
    is_object: bool = True
    frame_owner: str | None = None
    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict, compare=False)
    codec: str | None = None
