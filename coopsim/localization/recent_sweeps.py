"""An agent's points with their ages: those of its latest sweeps, and of the frame before, moved by odometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3
from coopsim.support.checks import require_count
from coopsim.types import NS_PER_S, PointCloud, SensorView

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
