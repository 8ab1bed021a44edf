"""Inputs of a policy: messages, observations, and each agent's specification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.types.estimates import Detections, GroundTruth
from coopsim.types.sensing import (
    CameraCalibration,
    CameraImage,
    LidarMounting,
    Odometry,
    PoseEstimate,
    SensorView,
    Sweep,
)
from coopsim.types.units import Mask

_STRANGER = "stranger_"

MOST_STRANGERS = 256
"""Largest number of senders in an inbox that are none of the environment's agents."""


def stranger(number: int) -> str:
    """Return the name of a sender that is none of the environment's agents."""
    return f"{_STRANGER}{number}"


def stranger_number(name: str) -> int | None:
    """Return the number of such a name; None for all other names."""
    number = name.removeprefix(_STRANGER)
    known = number != name and number.isdecimal() and int(number) < MOST_STRANGERS
    return int(number) if known else None


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """A broadcast of one agent.

    Attributes:
        sender: the agent's name, which is not empty.
        captured_ns: when the content was sensed (not when it was sent or arrived).
        pose: the sender's estimate of its own pose at that time.
        payload: the encoded content.
        codec: name of the codec that encoded it.
    """

    sender: str
    captured_ns: int
    pose: PoseEstimate
    payload: bytes
    codec: str
    _identity: tuple[Any, ...] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.sender:
            raise InvalidValueError("sender must be an agent's name, got ''")

    @property
    def identity(self) -> tuple[Any, ...]:
        """All of the message as a key, equal for copies of one broadcast. Made once for an object."""
        if self._identity is None:
            spread = self.pose.covariance
            pose = self.pose.xyz_yaw.tobytes(), None if spread is None else spread.tobytes()
            identity = self.sender, self.captured_ns, self.codec, *pose, self.payload
            object.__setattr__(self, "_identity", identity)
            return identity
        return self._identity


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Input of one agent in one frame; all but the inbox is in its current base frame.

    Attributes:
        time_ns: now, since the episode's start.
        pose: the global pose estimate.
        odometry: motion since the last observation.
        detections: the agent's own detections.
        sweeps: sweep of each LiDAR, by name.
        cameras: images by camera name; empty when cameras are off.
        inbox: messages that arrived since the last observation, oldest capture first.
        sensed: flag of a frame in which sensors and detector ran; False only with the option `sense_every` > 1: there
            are no points, images or detections.
        truth: the true objects, in `track` of a policy with `Needs(truth=True)`; None everywhere else.
        attackers: names of the senders that lie, in `track` of such a policy; None everywhere else.
        signals: ETSI's messages that arrived beside the inbox since the last observation, oldest capture first: SPATEM
            and MAPEM with the option `signal_messages`, MCM and DENM with `uplink="intents"`.
            `coopsim.comms.ReceivedLights` and `ReceivedIntents` read them.
    """

    time_ns: int
    pose: PoseEstimate
    odometry: Odometry
    detections: Detections
    sweeps: Mapping[str, Sweep] = field(default_factory=dict)
    cameras: Mapping[str, CameraImage] = field(default_factory=dict)
    inbox: tuple[Message, ...] = ()
    sensed: bool = True
    truth: GroundTruth | None = None
    attackers: frozenset[str] | None = None
    signals: tuple[bytes, ...] = ()

    def with_inbox(self, inbox: tuple[Message, ...]) -> Observation:
        """Return the observation with these messages, oldest capture first."""
        return replace(self, inbox=inbox)

    def view(self, spec: AgentSpec) -> SensorView:
        """Return the sensor data alone, with calibrations and mountings, as a `Detector` sees it.

        Args:
            spec: the agent's, of the running episode.
        """
        return SensorView(
            agent=spec.name,
            time_ns=self.time_ns,
            odometry=self.odometry,
            sweeps={name: sweep.without_truth() for name, sweep in self.sweeps.items()},
            images={name: image.without_truth() for name, image in self.cameras.items()},
            cameras=spec.cameras,
            lidars=spec.lidars,
            pose=self.pose,
        )


@dataclass(frozen=True, slots=True)
class MessagePart:
    """The part `message` of the actions of agents that decide what they say, see `uplink="action"`.

    Attributes:
        form: "scores" of detections, "cells" of a map of scores, or the "payload" of a codec.
        size: number of scores, or of cells along each side of the map; 0 for payloads.
        metres: length of the map's side.
        codec: spec of the codec of payloads.
        agents: names of all agents, in the order of `to` and `ask`; empty if an action has neither.
        to: an action says to whom its message goes.
        ask: an action says whose next messages the agent wants.
    """

    form: Literal["scores", "cells", "payload"]
    size: int
    metres: float
    codec: str
    agents: tuple[str, ...] = ()
    to: bool = False
    ask: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Said:
    """Content of an action's `message`, checked.

    Attributes:
        score: scores (N,), or a map (N, N) of them; None: nothing is said.
        payload: payload of a codec; None: nothing is said.
        to: mask (A,) of the agents that the message is for; None: all.
        ask: mask (A,) of the agents whose next messages are wanted; None: all.
    """

    score: Floats | None = None
    payload: bytes | None = None
    to: Mask | None = None
    ask: Mask | None = None


AGENT_KINDS = ("cav", "rsu", "drone")
"""Kinds of agents: connected cars, roadside units and drones."""


@dataclass(frozen=True, slots=True)
class AgentSpec:
    """Specification of an agent, known to a policy before the first frame.

    Attributes:
        name: unique name, such as `cav_0`, `rsu_0` or `drone_0`.
        kind: "cav" (drives), "rsu" (stands) or "drone" (flies; its base frame is on the ground under it).
        dt_s: time between two observations.
        uplink: the content that the agent broadcasts ("none", "detections", "tracks", "points", "features", "queries").
        command: part of the action by which the agent drives: "maneuver" under `control="policy"`, "acceleration_m_s2"
            under `control="acceleration"`, "steering" under `control="steering"`; None: the action does not drive it.
        is_object: others see the agent over the origin of its base frame, but it is not its own object. False for a
            roadside unit, and for a recording, which lacks the positions of its agents.
        frame_owner: the agent whose base frame all agents' boxes are in, as in a recording; None: each agent's boxes
            are in its own.
        cameras: calibration of each of its cameras, by name; of the running episode, as cars differ in height.
        codec: the codec that was asked for, with its parameters; None: the uplink's own choice.
        lidars: mounting of each of its LiDARs, by name; of the running episode, as cars differ in height. Empty where
            no rays are cast, as in a recording.
        sense_every: sensors and detector run in every n-th frame, beginning with the first.
        calibration: kind of its detector's scores and errors, see `DetectorBase.calibration`; None: unknown, as of a
            recording.
        message: the part of its action that says what it sends; None: its uplink decides.
    """

    name: str
    kind: Literal["cav", "rsu", "drone"]
    dt_s: float
    uplink: str = "none"
    command: Literal["maneuver", "acceleration_m_s2", "steering"] | None = None
    is_object: bool = True
    frame_owner: str | None = None
    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict, compare=False)
    codec: str | None = None
    lidars: Mapping[str, LidarMounting] = field(default_factory=dict, compare=False)
    sense_every: int = 1
    calibration: str | None = None
    message: MessagePart | None = None

    @property
    def drives(self) -> bool:
        """Flag of an agent whose action must say how to drive."""
        return self.command is not None


MANEUVERS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""Names of the discrete maneuvers, numbered as highway-env numbers its meta-actions."""

IDLE = MANEUVERS.index("idle")
"""The maneuver that changes nothing."""
