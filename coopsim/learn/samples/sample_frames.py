"""The clouds and boxes of samples: joined, moved from frame to frame, thinned and mirrored."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.localization.odometry import LONGEST_S, Points
from coopsim.types import NS_PER_S


def sweeps_of(clip: Clip, number: int, member: int, sweeps: int) -> Points:
    """Return an agent's points in a scene, (P, 5) with their age, in its base frame.

    Two sweeps have the points of the scene before, too, moved by odometry, unless it is a first scene, or scenes are
    further apart than frames that a policy joins.
    """
    agent = clip.scenes[number].agents[member]
    points = _with_age(agent.points, 0.0)
    if sweeps == 1 or not joined(clip, number):
        return points
    age_s = (clip.scenes[number].time_ns - clip.scenes[number - 1].time_ns) / NS_PER_S
    before = _with_age(clip.scenes[number - 1].agents[member].points, age_s)
    return np.concatenate([points, moved(before, np.zeros(4), agent.odometry)])


def joined(clip: Clip, number: int) -> bool:
    """Return whether the scene before is recent enough to be joined as a second sweep."""
    scenes = clip.scenes
    return number > 0 and scenes[number].time_ns - scenes[number - 1].time_ns <= LONGEST_S * NS_PER_S


def _with_age(points: NDArray[np.float32], age_s: float) -> Points:
    return np.column_stack([points, np.full(len(points), age_s, np.float32)])


def moved(points: Points, xyz_yaw: Floats, to_xyz_yaw: Floats) -> Points:
    """Return points (P, 5) x, y, z, intensity, age from the frame of a pose (4,) in that of another one."""
    cos, sin = np.cos(xyz_yaw[3] - to_xyz_yaw[3]), np.sin(xyz_yaw[3] - to_xyz_yaw[3])
    dx, dy = rotated((xyz_yaw[:2] - to_xyz_yaw[:2])[None], -to_xyz_yaw[3])[0]
    out, x, y = points.copy(), points[:, 0], points[:, 1]
    out[:, 0] = cos * x - sin * y + dx
    out[:, 1] = sin * x + cos * y + dy
    out[:, 2] += xyz_yaw[2] - to_xyz_yaw[2]
    return out


def boxes_in(boxes: Floats, velocity: Floats, to_xyz_yaw: Floats) -> tuple[Floats, Floats]:
    """Return boxes (N, 7) and velocities (N, 2), given in the world, in the frame of a pose (4,)."""
    out = boxes.copy()
    out[:, :2] = rotated(boxes[:, :2] - to_xyz_yaw[:2], -to_xyz_yaw[3])
    out[:, 2] -= to_xyz_yaw[2]
    out[:, 6] -= to_xyz_yaw[3]
    return out, rotated(velocity, -to_xyz_yaw[3])


def noisy(xyz_yaw: Floats, rng: np.random.Generator, noise_m: float, noise_rad: float) -> Floats:
    """Return an estimate of a pose (4,): x and y with an error of `noise_m`, the heading of `noise_rad`."""
    return xyz_yaw + rng.normal(size=4) * [noise_m, noise_m, 0.0, noise_rad]


def thin(points: Points, rng: np.random.Generator, share: float) -> Points:
    """Leave out up to three quarters of the points at random, in this share of calls."""
    if rng.random() >= share:
        return points
    return points[rng.random(len(points)) >= rng.uniform(0.0, 0.75)]


def mirror(points: Points, boxes: Floats, velocity: Floats) -> None:
    """Turn left and right around, in place: y becomes -y."""
    points[:, 1] *= -1
    boxes[:, [1, 6]] *= -1
    velocity[:, 1] *= -1


def tilt(points: Points, boxes: Floats, slope: Floats) -> None:
    """Raise points and boxes by these slopes (2,) along x and y, in place: what an agent sees that tilts a little."""
    points[:, 2] += (points[:, :2] @ slope).astype(np.float32)
    boxes[:, 2] += boxes[:, :2] @ slope


def rotated(xy: Floats, angle_rad: float) -> Floats:
    """Return points of the plane (N, 2), turned."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: Floats = xy @ np.array([[cos, sin], [-sin, cos]])
    return turned
