"""An agent's own pose over time: white noise is averaged out, what stays or wanders is followed."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.fusion.alignment import OwnPose
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.types import Odometry, PoseEstimate, stack_xyz_yaw

SIGMA = np.array([0.4, 0.4, 0.02])
STEP = np.array([1.0, 0.0, 0.0, 0.02])  # 10 m/s in a bend to the left
FRAMES = 300


def errors(noise: Floats, first_yaw: float = 3.0) -> Floats:
    """Return the errors (F, 3) of x, y and heading of a car in a circle whose stated poses have `noise` (F, 3)."""
    odometry, truth = Odometry(STEP), SE3.from_xyz_yaw([5.0, -3.0, 0.0], first_yaw)
    own, found = None, []
    for each in noise:
        true = stack_xyz_yaw(truth)
        stated = PoseEstimate(true + np.array([each[0], each[1], 0.0, each[2]]))
        if own is None:
            own = OwnPose(stated, SIGMA**2)
        else:
            own.step(stated, odometry)
        away = own.xyz_yaw - true
        found.append([away[0], away[1], wrap_angle(away[3])])
        truth = truth.compose(odometry.previous_SE3_current)
    return np.array(found)


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_is_averaged_out(seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, SIGMA, (FRAMES, 3))
    settled = errors(noise)[100:]
    assert (np.sqrt(np.mean(settled**2, axis=0)) < 0.45 * SIGMA).all()


def test_an_error_that_stays_is_left_to_the_shared_objects() -> None:
    bias = np.array([1.5, -0.8, 0.0])
    np.testing.assert_allclose(errors(np.tile(bias, (FRAMES, 1)))[-1], bias, atol=1e-6)


def test_one_that_wanders_is_followed() -> None:
    walk = np.cumsum(np.random.default_rng(0).normal(0, 0.03 * SIGMA, (FRAMES, 3)), axis=0)
    assert (np.abs(errors(walk) - walk).max(axis=0) < 0.5 * SIGMA).all()
