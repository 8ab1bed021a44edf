"""Points of now and of the frame before, where odometry puts them."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.localization.odometry import RecentSweeps, aged, turned
from coopsim.types import Odometry, PointCloud, SensorView, Sweep

FRAME_NS = 100_000_000


def view(time_ns: int, xyz: object, motion: object = (1.0, 0.0, 0.0, 0.0), agent: str = "cav_0") -> SensorView:
    points = np.asarray(xyz, dtype=np.float32).reshape(-1, 3)
    sweep = Sweep(points, np.full(len(points), 0.5, np.float32), np.zeros(len(points), np.int64))
    return SensorView(agent, time_ns, Odometry(np.asarray(motion, dtype=float)), {"top": sweep})


def test_one_sweep_has_no_past() -> None:
    recent = RecentSweeps()
    for k in range(2):
        np.testing.assert_allclose(recent.points(view(k, [[3, 1, 0.5]])), [[3, 1, 0.5, 0.5, 0]])


def test_a_standing_object_stands_still_in_two_sweeps() -> None:
    recent = RecentSweeps(2)
    recent.points(view(0, [[10, 0, 1]]))
    turn = (1.0, 0.0, 0.0, np.pi / 2)  # a metre ahead, then to the left: what was ahead is on the right
    points = recent.points(view(FRAME_NS, [[0, -9, 1]], turn))
    np.testing.assert_allclose(points, [[0, -9, 1, 0.5, 0], [0, -9, 1, 0.5, 0.1]], atol=1e-6)


def test_what_is_not_of_the_frame_before_is_left_out() -> None:
    recent = RecentSweeps(2)
    recent.points(view(0, [[10, 0, 1]]))
    assert len(recent.points(view(FRAME_NS, [[1, 1, 1]], agent="cav_1"))) == 1  # another agent's
    assert len(recent.points(view(9 * FRAME_NS, [[10, 0, 1]]))) == 1  # long ago
    assert len(recent.points(view(10 * FRAME_NS, [[10, 0, 1]]))) == 2
    assert len(recent.points(view(0, [[10, 0, 1]]))) == 1  # another episode
    assert len(recent.points(view(0, [[10, 0, 1]]))) == 1
    assert len(recent.points(view(FRAME_NS, np.zeros((0, 3))))) == 1


def test_points_are_turned_about_the_agent() -> None:
    points = turned(aged(PointCloud(np.array([[2, 0, 1]], np.float32), np.ones(1, np.float32)), 0.1), np.pi / 2)
    np.testing.assert_allclose(points, [[0, 2, 1, 1, 0.1]], atol=1e-6)


def test_three_sweeps_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"sweeps must be an integer in 1\.\.2, got 3"):
        RecentSweeps(3)
