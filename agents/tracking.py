"""The shape that tracking-by-detection policies share: collect detections, track them, report."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.agents.base import Policy
from coopsim.comms.message import decode_detections
from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.late import LATE, OWN, LateMeasurements, Measurement
from coopsim.tracking.odometry import OdometryFrame
from coopsim.tracking.tracker import Tracker, sane
from coopsim.types import AgentSpec, Detections, Mask, Message, Observation, Tracks


@dataclass
class _AgentState:
    tracks: LateMeasurements
    is_object: bool
    frame: OdometryFrame = field(default_factory=OdometryFrame)


class TrackingPolicy(Policy):
    """Tracks the agent's own detections and, if the policy listens (`uplink`), those of all others.

    Tracks are kept in the odometry frame, in which still things stand still and whose drift is slow, so that
    noise of the global pose reaches a track only through what other agents said. A box is moved there by the
    *estimated* poses of its sender, at capture, and of the receiver, now.

    Args:
        late: what to do with messages that come late: "as_current", "predict" or "replay" (see
            `coopsim.tracking.late`).
    """

    def __init__(self, late: str = "as_current") -> None:
        self._late = LATE.get(late)
        self._states: dict[str, _AgentState] = {}
        self.make_tracker()  # so that a wrong setting is refused here, not at the first episode

    @abstractmethod
    def make_tracker(self) -> Tracker | TrackersByClass:
        """A new tracker, for one agent and one episode."""

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        """What is made of one moment's detections, a group per agent: groups that are tracked in turn. First is the
        receiver's, or in a recording that of the agent whose frame it is, because it came through no estimated pose.
        By default each agent's own group updates the tracks.
        """
        return groups

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        first = OWN if spec.frame_owner in (None, spec.name) else spec.frame_owner
        self._states[spec.name] = _AgentState(self._late(self.make_tracker, self.fuse, first), spec.is_object)

    def track(self, agent: str, observation: Observation) -> Tracks:
        state = self._states[agent]
        state.frame.move(observation)
        odom_SE3_base = state.frame.odom_SE3_base
        own = Measurement(OWN, observation.time_ns, sane(observation.detections).transform(odom_SE3_base))
        heard = [] if self.uplink == "none" else self.read(agent, observation.inbox, decode_detections)
        others = [_received(message, found, observation, state) for message, found in heard]
        tracks = state.tracks.step([own, *others], observation.time_ns)
        return tracks.transform(odom_SE3_base.inverse())


def _received(message: Message, found: Detections, observation: Observation, state: _AgentState) -> Measurement:
    """A message's boxes in the odometry frame, without the receiver itself, which is not its own object."""
    found = sane(found).transform(state.frame.odom_SE3_sender(message, observation))
    if state.is_object:
        then = state.frame.pose_at(message.captured_ns)
        found = found[~over_origin(found.boxes.transform(then.inverse()))]
    return Measurement(message.sender, message.captured_ns, found)


def over_origin(boxes: Boxes3D) -> Mask:
    """Which boxes (N,) cover the origin on the ground."""
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    x, y = boxes.center[:, 0], boxes.center[:, 1]
    ahead, aside = np.abs(x * cos + y * sin), np.abs(y * cos - x * sin)
    over: Mask = (ahead <= boxes.size[:, 0] / 2) & (aside <= boxes.size[:, 1] / 2)
    return over
