"""Rays are told apart by hand-made cases: those that end in a claimed box, and those that go through it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from coopsim.defenses.lidar_rays import LidarRays
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3

HEIGHT_M = 2.0
CAR = [10.0, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0]
"""From x = 8 to 12 and from the ground to 1.6 m: its core begins at 0.3 m and ends at 1.12 m."""


def count(points: Any, *boxes: list[float], off_m: float = 0.0) -> tuple[list[int], list[int]]:
    """Return hits and crossings of rays that end in points, given in the base frame."""
    mounting = SimpleNamespace(base_SE3_lidar=SE3.from_xyz_yaw([0.0, 0.0, HEIGHT_M], 0.0))
    reception: Any = SimpleNamespace(
        observation=SimpleNamespace(sweeps={"roof": _Sweep(np.reshape(points, (-1, 3)))}),
        spec=SimpleNamespace(lidars={"roof": mounting}),
    )
    on, through = LidarRays(reception).count(Boxes3D.from_array(np.reshape(boxes, (-1, 7))), np.full(len(boxes), off_m))
    return on.tolist(), through.tolist()


class _Sweep:
    def __init__(self, points: Any) -> None:
        self.points = points.astype(np.float32)

    def __len__(self) -> int:
        return len(self.points)


def beyond(x: float, y: float, z: float, times: float) -> list[float]:
    """Return the end of the ray through a point, `times` as far from the LiDAR."""
    return [x * times, y * times, HEIGHT_M + (z - HEIGHT_M) * times]


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        pytest.param([8.1, 0.5, 0.9], (1, 0), id="ends on it"),
        pytest.param([8.1, 0.5, 0.1], (0, 0), id="ends on the ground below it"),
        pytest.param(beyond(10.0, 0.0, 0.8, 1.4), (0, 1), id="goes through it"),
        pytest.param(beyond(10.0, 0.0, 0.8, 0.7), (0, 0), id="ends before it"),
        pytest.param(beyond(8.1, 0.9, 1.0, 2.0), (0, 0), id="cuts its corner"),
        pytest.param(beyond(10.0, 4.0, 0.8, 2.0), (0, 0), id="passes beside it"),
        pytest.param([-8.1, 0.5, 0.9], (0, 0), id="looks away"),
    ],
)
def test_a_ray_hits_a_box_or_crosses_it_or_neither(end: list[float], expected: tuple[int, int]) -> None:
    on, through = count(end, CAR)
    assert (on[0], through[0]) == expected


def test_an_error_of_the_place_makes_the_box_larger_but_not_its_core() -> None:
    beside = [10.0, 1.4, 0.8]
    assert count(beside, CAR) == ([0], [0])
    assert count(beside, CAR, off_m=0.5) == ([1], [0])
    assert count(beyond(10.0, 1.1, 0.8, 1.4), CAR, off_m=0.5) == ([0], [0])


def test_a_turned_box_is_turned() -> None:
    across = [10.0, 0.0, 0.8, 4.0, 2.0, 1.6, np.pi / 2]
    assert count([10.0, 1.8, 0.8], CAR, across) == ([0, 1], [0, 0])


def test_boxes_behind_and_around_the_lidar_are_found() -> None:
    behind = [-10.0, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0]
    around = [0.0, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0]
    ends = [[-8.1, 0.1, 0.9], [-8.1, -0.1, 0.9], [1.0, 0.5, 0.9], [-1.0, -0.5, 0.9]]
    assert count(ends, behind, around) == ([2, 2], [0, 0])


def test_a_ray_along_a_side_counts_by_its_other_directions() -> None:
    # It starts at x = 0, as high as the LiDAR, and goes level along x: the box is as tall.
    tall = [10.0, 0.0, 2.0, 4.0, 2.0, 4.0, 0.0]
    assert count([14.0, 0.0, HEIGHT_M], tall) == ([0], [1])


def test_nothing_claimed_and_nothing_seen_are_no_error() -> None:
    assert count([[8.1, 0.5, 0.9]]) == ([], [])
    assert count(np.empty((0, 3)), CAR) == ([0], [0])
