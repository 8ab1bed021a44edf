"""An agent's past, carried on by its odometry: the frame in which it keeps its tracks, and its latest sweeps.

In the odometry frame (REP-105's `odom`) standing objects stand still, its drift is slow, and noise of the global pose
does not reach it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats, SE3Batch
from coopsim.support.checks import require_count
from coopsim.types import NS_PER_S, Message, Observation, PointCloud, SensorView

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


Points = NDArray[np.float32]
"""(P, 5): x, y, z m, intensity in [0, 1], age s."""

LONGEST_S = 0.25
"""Sweeps further apart than this are not joined: the odometry of a view covers one frame."""


def aged(cloud: PointCloud, age_s: float = 0.0) -> Points:
    """Return a cloud's points as rows with an age."""
    points = np.empty((len(cloud), 5), np.float32)
    points[:, :3], points[:, 3], points[:, 4] = cloud.xyz, cloud.intensity, age_s
    return points


def turned(points: Points, yaw_rad: float) -> Points:
    """Return points turned about z: from the base frame to axes in which the agent's heading is `yaw_rad`."""
    moved = points.copy()
    cos, sin = np.float32(np.cos(yaw_rad)), np.float32(np.sin(yaw_rad))
    moved[:, 0] = cos * points[:, 0] - sin * points[:, 1]
    moved[:, 1] = sin * points[:, 0] + cos * points[:, 1]
    return moved


class RecentSweeps:
    """The points of one or two frames of each agent, in its base frame now.

    A first frame has no points of a frame before; nor has one whose time is not later than the last one's, which is of
    another episode, or one long after it.

    Args:
        sweeps: number of frames, 1 or 2.
    """

    def __init__(self, sweeps: int = 1) -> None:
        require_count(1, 2, sweeps=sweeps)
        self._sweeps = sweeps
        self._before: dict[str, tuple[int, PointCloud]] = {}

    def points(self, view: SensorView) -> Points:
        """Return the agent's points of now and before; to be called once in each frame, in order."""
        cloud = PointCloud.of(*view.sweeps.values())
        if self._sweeps == 1:
            return aged(cloud)
        known, self._before[view.agent] = self._before.get(view.agent), (view.time_ns, cloud)
        if known is None or not 0 < view.time_ns - known[0] <= LONGEST_S * NS_PER_S:
            return aged(cloud)
        current_SE3_previous: SE3 = view.odometry.previous_SE3_current.inverse()
        before = aged(known[1].transform(current_SE3_previous), (view.time_ns - known[0]) / NS_PER_S)
        return np.concatenate([aged(cloud), before])
