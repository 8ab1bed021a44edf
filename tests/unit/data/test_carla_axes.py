"""CARLA's axes against OpenCOOD's formula of a pose, and there and back."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.data.files.carla_axes import from_carla_pose, mirror, to_carla_pose
from coopsim.geometry.se3 import SE3

ANGLES_RAD = np.linspace(-3.0, 3.0, 5)


def _turn(axis, angle):
    cos, sin, turn = np.cos(angle), np.sin(angle), np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a] = turn[b, b] = cos
    turn[b, a], turn[a, b] = sin, -sin
    return turn


def test_a_car_on_level_ground_turns_the_other_way():
    np.testing.assert_allclose(to_carla_pose(SE3.from_xyz_yaw([1, 2, 3], np.pi / 6)), [1, -2, 3, 0, -30, 0], atol=1e-9)


def test_a_nose_that_points_down_has_negative_pitch():
    down = SE3(_turn(1, 0.25), np.zeros(3))  # ours: positive about y looks down
    np.testing.assert_allclose(to_carla_pose(down), [0, 0, 0, 0, 0, -np.degrees(0.25)], atol=1e-9)


@pytest.mark.parametrize("yaw", ANGLES_RAD)
@pytest.mark.parametrize("pitch", [-np.pi / 2, -0.7, 0.0, 1.2, np.pi / 2])
@pytest.mark.parametrize("roll", ANGLES_RAD)
def test_every_pose_comes_back(yaw, pitch, roll):
    pose = SE3(_turn(2, yaw) @ _turn(1, pitch) @ _turn(0, roll), np.array([1.0, -2.0, 3.0]))
    again = from_carla_pose(to_carla_pose(pose))
    np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-7)
    np.testing.assert_allclose(again.translation, pose.translation)


def test_points_move_with_their_pose():
    pose, points = SE3(_turn(2, 2.0) @ _turn(1, 0.4), np.array([5.0, 6.0, 7.0])), np.array([[1.0, 2.0, 3.0]])
    x, y, z, roll, yaw, pitch = to_carla_pose(pose)
    s, c = np.sin(np.radians([roll, yaw, pitch])), np.cos(np.radians([roll, yaw, pitch]))
    (sr, sy, sp), (cr, cy, cp) = s, c
    there = np.array(
        [
            [cp * cy, cy * sp * sr - sy * cr, -cy * sp * cr - sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, -sy * sp * cr + cy * sr],
            [sp, -cp * sr, cp * cr],
        ]
    )
    np.testing.assert_allclose(mirror(points) @ there.T + [x, y, z], mirror(pose.apply(points)))
