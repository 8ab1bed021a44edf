"""The odometry frame, in which an agent keeps its tracks (REP-105's `odom`).

Standing objects stand still in it, its drift is slow, and noise of the global pose does not reach it.
"""

from __future__ import annotations

from coopsim.geometry.se3 import SE3
from coopsim.types import NS_PER_S, Message, Observation

_MEMORY_NS = 2 * NS_PER_S
"""Time for which an agent keeps its poses."""


class OdometryFrame:
    """Path of an agent in its odometry frame, whose origin is the agent's first pose.

    Attributes:
        odom_SE3_base: the agent's pose now.
    """

    def __init__(self) -> None:
        self.odom_SE3_base = SE3.identity()
        self._path: dict[int, SE3] = {}

    def move(self, observation: Observation) -> None:
        """Follow the odometry by one frame, and remember the pose for a while."""
        self.odom_SE3_base = self.odom_SE3_base.compose(observation.odometry.previous_SE3_current)
        now_ns = observation.time_ns
        self._path = {time_ns: pose for time_ns, pose in self._path.items() if time_ns >= now_ns - _MEMORY_NS}
        self._path[now_ns] = self.odom_SE3_base

    def pose_at(self, time_ns: int) -> SE3:
        """Return the remembered `odom_SE3_base` nearest in time to `time_ns`."""
        return self._path[min(self._path, key=lambda known_ns: abs(known_ns - time_ns))]

    def odom_SE3_sender(self, message: Message, observation: Observation) -> SE3:
        """Return a sender's pose at capture, by its *estimated* pose then and the receiver's estimated pose now."""
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        return self.odom_SE3_base.compose(base_SE3_world).compose(message.pose.world_SE3_base)
