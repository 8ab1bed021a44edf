"""The base of tracking-by-detection policies: collect detections, track them, report."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.agents.policy import Policy
from coopsim.comms.envelope import decode_detections
from coopsim.fusion.alignment import PoseAlignment, ReceivedBoxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.localization.odometry_frame import OdometryFrame
from coopsim.support.checks import require_flag
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.delayed import DELAYED, RECEIVER, DelayedMeasurements, Measurement
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections, Mask, Message, Observation, Tracks
from coopsim.types.valid_detections import FARTHEST_M, drop_unreportable


@dataclass
class _AgentState:
    tracks: DelayedMeasurements
    is_object: bool
    alignment: PoseAlignment | None
    frame: OdometryFrame = field(default_factory=OdometryFrame)


@dataclass(kw_only=True, eq=False)
class TrackingPolicy(Policy):
    """A tracker of the agent's own detections and, if `needs.uplink` is "detections", those of all senders.

    Tracks are kept in the odometry frame, in which standing objects stand still and whose drift is slow, so that noise
    of the global pose reaches a track only through messages. A received box is moved there by the *estimated* poses of
    its sender, at capture, and of the receiver, now.

    Subclasses are keyword-only dataclasses: their fields are the policy's parameters.

    Attributes:
        delayed: treatment of delayed messages: "as_current", "predict" or "replay" (see
            `coopsim.tracking.delayed`).
        align: correct the senders' poses by the objects that several agents see (see `coopsim.fusion.alignment`).
    """

    delayed: str = "as_current"
    align: bool = False

    def __post_init__(self) -> None:
        require_flag(align=self.align)
        DELAYED.get(self.delayed)
        self._states: dict[str, _AgentState] = {}
        self.make_tracker()  # so that a wrong setting is refused here, not at the first episode

    @abstractmethod
    def make_tracker(self) -> Tracker | TrackersByClass:
        """Return a new tracker, for one agent and one episode."""

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        """Turn one moment's detections, a group per agent, into the groups that update the tracks one after another.

        The first group is the receiver's or, in a recording, that of the agent whose frame it is, because it came
        through no estimated pose. By default each agent's own group updates the tracks.
        """
        return groups

    def perceive(self, agent: str, observation: Observation) -> Detections:
        """Return what `agent` detects now, in its base frame: by default its detector's detections.

        Override it in a policy with detections of its own, from points or fused features for example: odometry frame,
        delayed messages, alignment and tracker are inherited. Messages are in `observation.inbox`, see `read`.
        """
        return observation.detections

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        first = RECEIVER if spec.frame_owner in (None, spec.name) else spec.frame_owner
        tracks = DELAYED.get(self.delayed)(self.make_tracker, self.fuse, first)
        alignment = PoseAlignment.of(self.specs, spec.name) if self.align else None
        self._states[spec.name] = _AgentState(tracks, spec.is_object, alignment)

    def track(self, agent: str, observation: Observation) -> Tracks:
        state = self._states[agent]
        state.frame.move(observation)
        odom_SE3_base = state.frame.odom_SE3_base
        own = drop_unreportable(self.perceive(agent, observation)).transform(odom_SE3_base)
        reads = self.needs.uplink == "detections"
        read = self.read(agent, within_reach(observation), decode_detections) if reads else []
        received = [ReceivedBoxes(message, drop_unreportable(found)) for message, found in read]
        poses = _sender_poses(received, own, observation, state)
        measured = [Measurement(RECEIVER, observation.time_ns, own)]
        measured += [_measurement(each, pose, state) for each, pose in zip(received, poses, strict=True)]
        return state.tracks.step(measured, observation.time_ns).transform(odom_SE3_base.inverse())


def _sender_poses(
    received: Sequence[ReceivedBoxes], own: Detections, observation: Observation, state: _AgentState
) -> list[SE3]:
    """Return the pose of each message's sender in the odometry frame, at capture."""
    if state.alignment is not None:
        return state.alignment.place(observation, state.frame, own, received)
    return [state.frame.odom_SE3_sender(each.message, observation) for each in received]


def _measurement(received: ReceivedBoxes, odom_SE3_sender: SE3, state: _AgentState) -> Measurement:
    """Return a message's boxes in the odometry frame, without the receiver itself, which is not its own object."""
    message, found = received.message, received.detections.transform(odom_SE3_sender)
    if state.is_object:
        then = state.frame.pose_at(message.captured_ns)
        found = found[~over_origin(found.boxes.transform(then.inverse()))]
    return Measurement(message.sender, message.captured_ns, found)


def within_reach(observation: Observation) -> list[Message]:
    """Return the messages with a stated sender pose within `FARTHEST_M` of the receiver."""
    here = observation.pose.xyz_yaw[:3]
    return [each for each in observation.inbox if np.abs(each.pose.xyz_yaw[:3] - here).max() <= FARTHEST_M]


def over_origin(boxes: Boxes3D) -> Mask:
    """Return the mask (N,) of boxes that cover the origin on the ground."""
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    x, y = boxes.center[:, 0], boxes.center[:, 1]
    ahead, aside = np.abs(x * cos + y * sin), np.abs(y * cos - x * sin)
    over: Mask = (ahead <= boxes.size[:, 0] / 2) & (aside <= boxes.size[:, 1] / 2)
    return over
