"""Pose noise is white, odometry drifts, and sizes are as configured."""

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.localization import LocalizationConfig, Localizer

POSES = [SE3.from_xyz_yaw([0.8 * k, 0.1 * k, 0], 0.02 * k) for k in range(2000)]


def errors(config: LocalizationConfig, agent: str = "cav_0") -> tuple[np.ndarray, np.ndarray]:
    localizer = Localizer(config, 3, agent)
    estimates = [localizer.localize(pose) for pose in POSES]
    truth = np.array([np.append(pose.translation, 0.02 * k) for k, pose in enumerate(POSES)])
    pose_error = np.array([pose.xyz_yaw for pose, _ in estimates]) - truth
    pose_error[:, 3] = (pose_error[:, 3] + np.pi) % (2 * np.pi) - np.pi
    motion = np.array([odometry.xyz_yaw for _, odometry in estimates])
    return pose_error, motion


def test_no_noise_is_exact() -> None:
    pose_error, motion = errors(LocalizationConfig(0, 0, 0, 0))
    np.testing.assert_allclose(pose_error, 0, atol=1e-9)
    np.testing.assert_array_equal(motion[0], 0)
    reached = SE3.identity()
    for step in motion:
        reached = reached.compose(SE3.from_xyz_yaw(step[:3], step[3]))
    np.testing.assert_allclose(reached.translation, POSES[-1].translation, atol=1e-6)


def test_noise_has_the_configured_size() -> None:
    pose_error, _ = errors(LocalizationConfig(0.5, 0.02, 0, 0))
    np.testing.assert_allclose(pose_error[:, [0, 1, 3]].std(axis=0), [0.5, 0.5, 0.02], rtol=0.06)
    np.testing.assert_array_equal(pose_error[:, 2], 0)
    lag_one = np.corrcoef(pose_error[:-1, 0], pose_error[1:, 0])[0, 1]
    assert abs(lag_one) < 0.08


def test_noise_scales_without_changing_shape() -> None:
    small, _ = errors(LocalizationConfig(position_noise_m=0.1))
    large, _ = errors(LocalizationConfig(position_noise_m=0.3))
    np.testing.assert_allclose(large[:, :2], 3 * small[:, :2], atol=1e-9)


def test_a_standing_unit_knows_that_it_stands() -> None:
    localizer = Localizer(LocalizationConfig(odometry_noise_m=1.0), 0, "rsu_0", stands=True)
    for _ in range(3):
        _, odometry = localizer.localize(SE3.identity())
        np.testing.assert_array_equal(odometry.xyz_yaw, 0)


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_bad_noise(value: float) -> None:
    with pytest.raises(InvalidValueError, match="heading_noise_rad must be a finite number >= 0"):
        LocalizationConfig(heading_noise_rad=value)
