"""Upright base frames of agents, from the poses of sensors that tilt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3
from coopsim.types import Sweep


def base_under(world_SE3_sensor: SE3, height_m: float) -> SE3:
    """Return the upright frame on the ground under a sensor that is so high above it, x along the sensor's heading."""
    return SE3.from_xyz_yaw(world_SE3_sensor.translation - [0.0, 0.0, height_m], world_SE3_sensor.yaw)


def sweep_in_base(
    base_SE3_lidar: SE3, points: NDArray[np.float32], intensity: NDArray[np.float32] | None, full_scale: float = 1.0
) -> Sweep:
    """Return the points of a file as a sweep in the base frame.

    Args:
        base_SE3_lidar: pose of the LiDAR, with its tilt.
        points: (P, 3) m in the LiDAR's frame.
        intensity: (P,) in the file's own unit; None: there is none, and all are 0.
        full_scale: the intensity that counts as 1; larger ones do, too.
    """
    moved = points
    if not _is_identity(base_SE3_lidar):
        moved = base_SE3_lidar.apply(points).astype(np.float32)
    count = len(points)
    bright = np.zeros(count, np.float32) if intensity is None else np.clip(intensity / np.float32(full_scale), 0, 1)
    return Sweep(moved, bright, np.zeros(count, np.int64))


def _is_identity(pose: SE3) -> bool:
    return bool((pose.rotation == np.eye(3)).all() and not pose.translation.any())
