"""Our filter against filterpy's, track by track; and what must always hold of a covariance."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from coopsim.tracking.motion import kalman
from coopsim.tracking.motion.constant_velocity import ConstantVelocity


def ab3dmot_filter(box: np.ndarray) -> KalmanFilter:
    """AB3DMOT's filter as its authors set it up: one unit of time is one frame of 0.1 s."""
    reference = KalmanFilter(dim_x=10, dim_z=7)
    reference.F = np.eye(10)
    reference.F[[0, 1, 2], [7, 8, 9]] = 1.0
    reference.H = np.eye(7, 10)
    reference.P[7:, 7:] *= 1000.0
    reference.P *= 10.0
    reference.Q[7:, 7:] *= 0.01
    reference.x[:7, 0] = box
    return reference


def test_constant_velocity_is_ab3dmots_filter_at_ten_hertz() -> None:
    rng = np.random.default_rng(0)
    boxes = rng.normal(size=(6, 7)) + np.array([0, 0, 0, 5, 3, 2, 0])
    boxes[:, 6] *= 0.1
    motion = ConstantVelocity()
    beliefs = motion.initiate(boxes, None)
    references = [ab3dmot_filter(box) for box in boxes]
    for _ in range(30):
        beliefs = motion.predict(beliefs, 0.1)
        boxes = boxes + rng.normal(scale=0.05, size=boxes.shape) + [0.8, 0.1, 0, 0, 0, 0, 0]
        beliefs = motion.update(beliefs, boxes, None)
        for reference, box in zip(references, boxes, strict=True):
            reference.predict()
            reference.update(box)
    expected = np.array([reference.x[:, 0] for reference in references])
    expected[:, 7:] /= 0.1  # metres a frame to metres a second
    np.testing.assert_allclose(beliefs.mean, expected, atol=1e-8)
    scale = np.diag([1.0] * 7 + [10.0] * 3)
    covariance = np.array([scale @ reference.P @ scale for reference in references])
    np.testing.assert_allclose(beliefs.covariance, covariance, rtol=1e-7, atol=1e-9)


def test_batched_filter_with_full_noise_is_filterpys() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 7, 7))
    noise = root @ root.transpose(0, 2, 1) + np.eye(7)
    root = rng.normal(size=(4, 10, 10))
    covariance = root @ root.transpose(0, 2, 1) + np.eye(10)
    mean, measured = rng.normal(size=(4, 10)), rng.normal(size=(4, 7))
    got = kalman.update(mean, covariance, measured - mean[:, :7], noise)
    for k in range(4):
        reference = KalmanFilter(dim_x=10, dim_z=7)
        reference.x, reference.P, reference.H = mean[k][:, None], covariance[k], np.eye(7, 10)
        reference.update(measured[k], R=noise[k])
        np.testing.assert_allclose(got[0][k], reference.x[:, 0], atol=1e-9)
        np.testing.assert_allclose(got[1][k], reference.P, atol=1e-9)


def test_two_short_steps_are_one_long_step_in_the_mean() -> None:
    motion = ConstantVelocity()
    beliefs = motion.initiate(np.array([[0.0, 0, 0, 4, 2, 1.5, 0]]), None)
    beliefs = motion.update(motion.predict(beliefs, 0.1), np.array([[1.0, 0, 0, 4, 2, 1.5, 0]]), None)
    halves = motion.predict(motion.predict(beliefs, 0.15), 0.15)
    np.testing.assert_allclose(halves.mean, motion.predict(beliefs, 0.3).mean, atol=1e-12)


@given(st.lists(st.tuples(st.floats(0, 2), st.booleans()), min_size=1, max_size=40), st.integers(0, 2**31))
def test_covariances_stay_symmetric_and_positive_definite(steps: list[tuple[float, bool]], seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = ConstantVelocity()
    beliefs = motion.initiate(rng.normal(size=(3, 7)), None)
    for dt_s, seen in steps:
        beliefs = motion.predict(beliefs, dt_s)
        if seen:
            beliefs = motion.update(beliefs, rng.normal(scale=100, size=(3, 7)), None)
    np.testing.assert_allclose(beliefs.covariance, beliefs.covariance.transpose(0, 2, 1), rtol=1e-12)
    assert (np.linalg.eigvalsh(beliefs.covariance) > 0).all()


def test_a_detection_turned_half_round_does_not_turn_the_track() -> None:
    motion = ConstantVelocity()
    beliefs = motion.initiate(np.array([[0.0, 0, 0, 4, 2, 1.5, 3.1]]), None)
    for yaw in (3.1, 3.1 - np.pi, -3.1, 0.05, 3.12):
        beliefs = motion.update(motion.predict(beliefs, 0.1), np.array([[0.0, 0, 0, 4, 2, 1.5, yaw]]), None)
        assert np.cos(motion.boxes(beliefs)[0, 6] - 3.1) > 0.99


def test_a_sure_detection_pulls_harder_than_an_unsure_one() -> None:
    motion = ConstantVelocity()
    start = motion.predict(motion.initiate(np.zeros((2, 7)), None), 0.1)
    noise = np.eye(7) * np.array([0.01, 1e6])[:, None, None]
    moved = motion.update(start, np.ones((2, 7)), noise).mean[:, 0]
    assert moved[0] > 0.99 > moved[1]


def test_only_what_is_a_covariance_is_used_as_noise() -> None:
    own = np.eye(2) * 9.0
    good = [np.eye(2), np.array([[2.0, 1.0], [1.0 + 1e-7, 2.0]]), np.eye(2) * 1e-12]
    bad = [[[np.nan, 0], [0, 1]], [[1, 0], [0, np.inf]], [[1, 2], [2, 1]], [[1, 1], [1, 1]], [[1, 0.5], [0, 1]]]
    np.testing.assert_array_equal(kalman.usable_noise(np.array(good), own), good)
    for each in bad:
        stated = np.array([*good, each])
        np.testing.assert_array_equal(kalman.usable_noise(stated, own), [*good, own])
