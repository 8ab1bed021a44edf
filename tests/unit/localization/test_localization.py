"""Pose noise is white, odometry drifts, and sizes are as configured."""

import numpy as np
import pytest
from representatives import all_of
from scipy import stats

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.localization.localizer import LocalizationConfig, Localizer
from coopsim.localization.pose_noise import PoseError, PoseNoise

POSES = [SE3.from_xyz_yaw([0.8 * k, 0.1 * k, 0], 0.02 * k) for k in range(2000)]


def errors(config: LocalizationConfig, agent: str = "cav_0") -> tuple[np.ndarray, np.ndarray]:
    localizer = Localizer(config, 3, agent)
    estimates = [localizer.localize(pose) for pose in POSES]
    truth = np.array([np.append(pose.translation, 0.02 * k) for k, pose in enumerate(POSES)])
    pose_error = np.array([pose.xyz_yaw for pose, _ in estimates]) - truth
    pose_error[:, 3] = (pose_error[:, 3] + np.pi) % (2 * np.pi) - np.pi
    motion = np.array([odometry.xyz_yaw for _, odometry in estimates])
    return pose_error, motion


def run_error(
    noise: PoseNoise, frames: int, seed: int = 3, agent: str = "cav_0", dt_s: float = 0.1
) -> list[np.ndarray | None]:
    error = PoseError(noise, seed, agent, dt_s)
    return [error.step() for _ in range(frames)]


def test_no_noise_is_exact() -> None:
    pose_error, motion = errors(LocalizationConfig(PoseNoise(), 0, 0))
    np.testing.assert_allclose(pose_error, 0, atol=1e-9)
    np.testing.assert_array_equal(motion[0], 0)
    reached = SE3.identity()
    for step in motion:
        reached = reached.compose(SE3.from_xyz_yaw(step[:3], step[3]))
    np.testing.assert_allclose(reached.translation, POSES[-1].translation, atol=1e-6)


def test_noise_has_the_configured_size() -> None:
    pose_error, _ = errors(LocalizationConfig(PoseNoise(0.5, 0.02), 0, 0))
    np.testing.assert_allclose(pose_error[:, [0, 1, 3]].std(axis=0), [0.5, 0.5, 0.02], rtol=0.06)
    np.testing.assert_array_equal(pose_error[:, 2], 0)
    lag_one = np.corrcoef(pose_error[:-1, 0], pose_error[1:, 0])[0, 1]
    assert abs(lag_one) < 0.08


def test_noise_scales_without_changing_shape() -> None:
    small, _ = errors(LocalizationConfig(PoseNoise(0.1)))
    large, _ = errors(LocalizationConfig(PoseNoise(0.3)))
    np.testing.assert_allclose(large[:, :2], 3 * small[:, :2], atol=1e-9)


def test_a_standing_unit_knows_that_it_stands() -> None:
    localizer = Localizer(LocalizationConfig(odometry_noise_m=1.0), 0, "rsu_0", stands=True)
    for _ in range(3):
        _, odometry = localizer.localize(SE3.identity())
        np.testing.assert_array_equal(odometry.xyz_yaw, 0)


def test_laplace_noise_has_the_same_deviation_and_longer_tails() -> None:
    """Laplace's excess kurtosis is 3; ranks are those of the Gaussian noise of the same seed."""
    gaussian, _ = errors(LocalizationConfig(PoseNoise(0.5, 0.02)))
    laplace, _ = errors(LocalizationConfig(PoseNoise(0.5, 0.02, "laplace")))
    np.testing.assert_allclose(laplace[:, [0, 1, 3]].std(axis=0), [0.5, 0.5, 0.02], rtol=0.1)
    np.testing.assert_array_equal(np.argsort(laplace[:, 0]), np.argsort(gaussian[:, 0]))
    assert stats.kstest(laplace[:, 0], stats.laplace(scale=0.5 / np.sqrt(2)).cdf).pvalue > 0.05
    assert stats.kstest(laplace[:, 0], stats.norm(scale=0.5).cdf).pvalue < 0.001


def test_wandering_noise_keeps_its_deviation_and_forgets_over_its_time() -> None:
    error = np.array(run_error(PoseNoise(0.5, correlation_s=1.0), 40_000))[:, 0]
    assert error.std() == pytest.approx(0.5, rel=0.07)
    for frames in (1, 5, 10, 20):
        got = np.corrcoef(error[:-frames], error[frames:])[0, 1]
        assert got == pytest.approx(np.exp(-frames * 0.1), abs=0.06)


def test_wandering_does_not_depend_on_the_frame_rate() -> None:
    fine = np.array(run_error(PoseNoise(0.5, correlation_s=1.0), 40_000, dt_s=0.05))[:, 0]
    assert np.corrcoef(fine[:-20], fine[20:])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)


def test_a_bias_is_constant_and_another_for_each_seed_and_agent() -> None:
    noise = PoseNoise(position_bias_m=0.4, heading_bias_rad=0.01)
    biases = []
    for seed in range(400):
        first, second = run_error(noise, 2, seed=seed)
        np.testing.assert_array_equal(first, second)
        biases.append(first)
    np.testing.assert_allclose(np.std(biases, axis=0), [0.4, 0.4, 0, 0.01], rtol=0.12)
    other = run_error(noise, 1, agent="cav_1")[0]
    assert not np.array_equal(other, biases[0])


def test_jumps_come_as_often_and_are_as_large_as_they_say() -> None:
    error = np.array(run_error(PoseNoise(jump_m=2.0, jumps_per_s=0.5), 40_000))[:, :2]
    jumped = np.any(np.diff(error, axis=0) != 0, axis=1)
    assert jumped.sum() == pytest.approx(40_000 * -np.expm1(-0.05), rel=0.05)
    np.testing.assert_array_equal(error[0], 0)
    assert error[1:][jumped].std() == pytest.approx(2.0, rel=0.05)


def test_outages_are_as_long_and_as_frequent_as_they_say() -> None:
    dark = np.array([error is None for error in run_error(PoseNoise(outage_s=2.0, outages_per_s=0.1), 60_000)])
    starts = np.count_nonzero(dark[1:] & ~dark[:-1])
    # In frames of 0.1 s a stay is geometric: its mean is 1 / (1 - exp(-dt / mean)) frames.
    assert dark.sum() / starts == pytest.approx(1 / -np.expm1(-0.1 / 2.0), rel=0.1)
    assert starts / (~dark).sum() == pytest.approx(-np.expm1(-0.01), rel=0.1)


def test_without_reception_odometry_carries_on() -> None:
    noise = PoseNoise(outage_s=1e6, outages_per_s=1e6)  # from the first frame on, for good
    exact, _ = errors(LocalizationConfig(noise, 0, 0))
    np.testing.assert_allclose(exact, 0, atol=1e-8)
    drifting, _ = errors(LocalizationConfig(noise, 0, 0, odometry_scale=0.01))
    assert np.abs(drifting[-1, :2]).max() > 0.1 > np.abs(drifting[10, :2]).max()


def test_odometry_drifts_by_scale_and_turn() -> None:
    truth = errors(LocalizationConfig(PoseNoise(), 0, 0))[1]
    scaled = errors(LocalizationConfig(PoseNoise(), 0, 0, odometry_scale=0.01))[1]
    ratio = scaled[1:, 0] / truth[1:, 0]
    assert np.ptp(ratio) < 1e-9 and 0 < abs(ratio[0] - 1) < 0.04
    turned = errors(LocalizationConfig(PoseNoise(), 0, 0, odometry_drift_rad_s=0.01))[1] - truth
    assert np.ptp(turned[1:, 3]) < 1e-9 and 0 < abs(turned[1, 3]) < 0.004
    np.testing.assert_array_equal(turned[:, :3], 0)


def test_other_errors_leave_the_white_noise_alone() -> None:
    plain, _ = errors(LocalizationConfig(PoseNoise(0.5), 0, 0))
    biased, _ = errors(LocalizationConfig(PoseNoise(0.5, position_bias_m=1.0), 0, 0))
    assert np.ptp(biased - plain, axis=0).max() < 1e-9


@pytest.mark.parametrize("outage", all_of([False, True], True))
def test_an_honest_covariance_is_that_of_the_errors(outage: bool) -> None:
    """Over many seeds; in an outage of 100 frames all errors of the odometry have added up."""
    noise = PoseNoise(0.3, 0.02, "laplace", 1.0, 0.2, 0.01, 1.0, 0.1)
    config = LocalizationConfig(noise, 0.02, 0.002, 0.01, 0.002, covariance_scale=1.0)
    truth = [SE3.from_xyz_yaw([0.8 * k, 0.1 * k, 0], 0.005 * k) for k in range(101)]
    found, stated = [], []
    for seed in range(600):
        localizer = Localizer(config, seed, "cav_0")
        for k, pose in enumerate(truth):
            if outage and k == 1:
                localizer._pose_error.step = lambda: None  # type: ignore[method-assign]
            estimate, _ = localizer.localize(pose)
        error = estimate.xyz_yaw - np.append(truth[-1].translation, truth[-1].yaw)
        found.append(error[[0, 1, 3]])
        stated.append(estimate.covariance)
    got, mean_stated = np.cov(np.array(found).T), np.mean(stated, axis=0)
    sigma = np.sqrt(np.diagonal(mean_stated))
    np.testing.assert_allclose(got / np.outer(sigma, sigma), mean_stated / np.outer(sigma, sigma), atol=0.15)


def test_overconfidence_is_a_factor_and_none_is_none() -> None:
    def stated(scale: float | None) -> np.ndarray | None:
        config = LocalizationConfig(PoseNoise(0.3, 0.02), covariance_scale=scale)
        return Localizer(config, 0, "cav_0").localize(POSES[0])[0].covariance

    assert stated(None) is None
    np.testing.assert_allclose(stated(1.0), np.diag([0.09, 0.09, 0.0004]))
    np.testing.assert_allclose(stated(0.25), np.diag([0.09, 0.09, 0.0004]) / 4)


def test_a_standing_unit_grows_no_less_certain() -> None:
    config = LocalizationConfig(PoseNoise(0.3, outage_s=1e6, outages_per_s=1e6), 0.1, covariance_scale=1.0)
    localizer = Localizer(config, 0, "rsu_0", stands=True)
    for _ in range(5):
        np.testing.assert_array_equal(localizer.localize(SE3.identity())[0].covariance, 0)


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
@pytest.mark.parametrize("name", ["heading_noise_rad", "correlation_s", "position_bias_m"])
def test_bad_noise(name: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} must be a finite number >= 0"):
        PoseNoise(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PoseNoise(distribution="cauchy"), "unknown distribution 'cauchy'"),
        (lambda: PoseNoise(jump_m=1.0), "jump_m and jumps_per_s must be both 0 or both > 0, got 1.0 and 0.0"),
        (lambda: PoseNoise(outages_per_s=1.0), "outage_s and outages_per_s must be both"),
        (lambda: LocalizationConfig(odometry_scale=-1), "odometry_scale must be a finite number >= 0"),
        (lambda: LocalizationConfig(0.5), "pose must be a coopsim PoseNoise or None, got 0.5"),
        (lambda: LocalizationConfig(None), "pose must be a coopsim PoseNoise, got None"),
        (lambda: LocalizationConfig(covariance_scale=0), "covariance_scale must be a finite number > 0, got 0"),
        (lambda: Localizer(LocalizationConfig(), 0, "cav_0", 0.0), "dt_s must be a finite number > 0"),
    ],
)
def test_bad_localization(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(CoopsimError, match=match):
        make()
