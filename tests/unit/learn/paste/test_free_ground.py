"""Ground of sweeps: heights and free places, in scenes whose ground is known."""

from __future__ import annotations

import numpy as np
import pytest
from bare_sweeps import ORIGIN_M, bare_sweep
from sensor_scenes import box_part

from coopsim.learn.paste.free_ground import FreeGround


@pytest.fixture(scope="module")
def street() -> FreeGround:
    """A street with a wall at y = -9 m and a box as large as a car at 12 m."""
    walls = box_part([4, -9, 1.5], (30, 1, 3)), box_part([12, 3, 0.8], (4.5, 1.8, 1.6))
    return FreeGround(bare_sweep(*walls)[:, :3].astype(np.float64), ORIGIN_M)


def car(x: float, y: float, yaw: float = 0.0) -> np.ndarray:
    return np.array([x, y, 0.8, 4.5, 1.8, 1.6, yaw])


@pytest.mark.parametrize(
    ("x", "y", "yaw", "fits"),
    [
        (10.0, -3.0, 0.0, True),
        (-12.0, 2.0, 0.7, True),
        (12.0, 3.0, 0.0, False),  # in the box that is there
        (12.0, 4.6, 0.0, False),  # beside it, too near
        (4.0, -8.5, 0.0, False),  # in the wall
        (4.0, -12.0, 0.0, False),  # behind it
        (4.0, -6.9, np.pi / 2, False),  # across, into it
        (4.0, -6.9, 0.0, True),
        (90.0, 0.0, 0.0, False),  # out of the map
    ],
)
def test_cars_fit_on_free_ground_alone(street: FreeGround, x: float, y: float, yaw: float, fits: bool) -> None:
    assert street.fits(car(x, y, yaw)) is fits


def test_what_is_taken_in_a_copy_is_free_in_the_original(street: FreeGround) -> None:
    copied = street.copy()
    copied.take(car(10.0, -3.0))
    assert not copied.fits(car(10.5, -3.5, 1.0)) and street.fits(car(10.5, -3.5, 1.0))


def test_heights_follow_slopes_and_steep_ground_is_not_taken() -> None:
    x, y = np.meshgrid(np.arange(-30, 30, 0.3), np.arange(-30, 30, 0.3))
    places = np.column_stack([x.ravel(), y.ravel()])
    for slope, fits in ((0.04, True), (0.4, False)):
        points = np.column_stack([places, slope * places[:, 0].clip(-6, 6)])
        ground = FreeGround(points, np.array([0.0, 0.0, 1.9]))
        spots = np.array([[2.0, 5.0], [-3.0, 4.0]])
        np.testing.assert_allclose(ground.heights(spots), slope * spots[:, 0], atol=0.03 + slope)
        assert ground.fits(car(3.0, 4.0)) is fits


def test_without_points_nothing_fits() -> None:
    assert not FreeGround(np.zeros((0, 3)), ORIGIN_M).fits(car(5.0, 0.0))
