"""The odometry frame, in which an agent keeps its tracks (REP-105's `odom`).

Standing objects stand still in it, its drift is slow, and noise of the global pose does not reach it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.geometry.se3_batch import SE3Batch
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

    def positions_at(self, times_ns: Sequence[int]) -> Floats:
        """Return the remembered positions (M, 3) m nearest in time to M times, at least one."""
        known = {time_ns: self.pose_at(time_ns).translation for time_ns in set(times_ns)}
        return np.concatenate([known[time_ns] for time_ns in times_ns]).reshape(-1, 3)

    def odom_SE3_senders(self, messages: Sequence[Message], observation: Observation) -> SE3Batch:
        """Return each sender's pose at capture, by its *estimated* pose then and the receiver's estimated pose now."""
        if not messages:
            return SE3Batch.of([])
        world_SE3_senders = SE3Batch.from_xyz_yaw(stated_poses(messages))
        return world_SE3_senders.seen_from(self.odom_SE3_base.compose(observation.pose.world_SE3_base.inverse()))


def stated_poses(messages: Sequence[Message]) -> Floats:
    """Return the senders' estimates of their poses at capture (M, 4): x, y, z m and heading rad."""
    return np.concatenate([np.zeros(0), *(each.pose.xyz_yaw for each in messages)]).reshape(-1, 4)
