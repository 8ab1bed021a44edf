"""The shape that tracking-by-detection policies share: collect detections, track them, report."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.agents.base import Policy
from coopsim.comms.message import decode_detections
from coopsim.geometry.se3 import SE3
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.late import LATE, OWN, LateMeasurements, Measurement
from coopsim.tracking.tracker import Tracker, sane
from coopsim.types import NS_PER_S, AgentSpec, Detections, Mask, Message, Observation, Tracks

_MEMORY_NS = 2 * NS_PER_S
"""How long an agent remembers where it was."""


@dataclass
class _AgentState:
    tracks: LateMeasurements
    is_object: bool
    odom_SE3_base: SE3 = field(default_factory=SE3.identity)
    path: dict[int, SE3] = field(default_factory=dict)

    def move(self, observation: Observation) -> None:
        """Follow the odometry, and remember the way for a while."""
        self.odom_SE3_base = self.odom_SE3_base.compose(observation.odometry.previous_SE3_current)
        now_ns = observation.time_ns
        self.path = {time_ns: pose for time_ns, pose in self.path.items() if time_ns >= now_ns - _MEMORY_NS}
        self.path[now_ns] = self.odom_SE3_base

    def pose_at(self, time_ns: int) -> SE3:
        """Where the agent was, as far as it remembers: `odom_SE3_base` at the moment nearest to `time_ns`."""
        return self.path[min(self.path, key=lambda known_ns: abs(known_ns - time_ns))]


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
        state.move(observation)
        own = Measurement(OWN, observation.time_ns, sane(observation.detections).transform(state.odom_SE3_base))
        others = [] if self.uplink == "none" else [_received(each, observation, state) for each in observation.inbox]
        tracks = state.tracks.step([own, *others], observation.time_ns)
        return tracks.transform(state.odom_SE3_base.inverse())


def _received(message: Message, observation: Observation, state: _AgentState) -> Measurement:
    """A message's boxes in the odometry frame, without the receiver itself, which is not its own object."""
    base_SE3_world = observation.pose.world_SE3_base.inverse()
    odom_SE3_sender = state.odom_SE3_base.compose(base_SE3_world).compose(message.pose.world_SE3_base)
    found = sane(decode_detections(message)).transform(odom_SE3_sender)
    if state.is_object:
        found = found[~over_origin(found.transform(state.pose_at(message.captured_ns).inverse()))]
    return Measurement(message.sender, message.captured_ns, found)


def over_origin(detections: Detections) -> Mask:
    """Which boxes (N,) cover the origin on the ground."""
    boxes = detections.boxes
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    x, y = boxes.center[:, 0], boxes.center[:, 1]
    ahead, aside = np.abs(x * cos + y * sin), np.abs(y * cos - x * sin)
    over: Mask = (ahead <= boxes.size[:, 0] / 2) & (aside <= boxes.size[:, 1] / 2)
    return over
