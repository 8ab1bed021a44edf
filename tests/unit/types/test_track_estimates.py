"""Tracks with covariance, moved in space and time."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.types import Tracks
from coopsim.types.track_estimates import TrackEstimates


def some(count: int = 3, seed: int = 0) -> TrackEstimates:
    rng = np.random.default_rng(seed)
    rows = np.column_stack([rng.uniform(-50, 50, (count, 3)), np.full((count, 3), 2.0), rng.uniform(-3, 3, count)])
    root = rng.normal(size=(count, 4, 4))
    tracks = Tracks(
        np.arange(count), Boxes3D.from_array(rows), rng.normal(0, 9, (count, 2)), rng.random(count), np.zeros(count)
    )
    return TrackEstimates(tracks, root @ root.transpose(0, 2, 1) + 0.01 * np.eye(4))


def test_transforming_moves_a_cloud_of_samples_alike() -> None:
    """Mean and covariance of samples that are moved one by one are those of the moved estimate."""
    estimate, pose = some(1), SE3.from_xyz_yaw([5, -3, 1], 2.0)
    samples = np.random.default_rng(1).multivariate_normal(estimate.mean[0], estimate.covariance[0], 200_000)
    position = pose.apply(np.column_stack([samples[:, :2], np.zeros(len(samples))]))[:, :2]
    moved = np.column_stack([position, pose.rotate_planar(samples[:, 2:])])
    expected = estimate.transform(pose)
    np.testing.assert_allclose(moved.mean(axis=0), expected.mean[0], atol=0.03)
    np.testing.assert_allclose(np.cov(moved.T), expected.covariance[0], atol=0.1)


def test_many_move_each_by_its_own_pose() -> None:
    parts, poses = [some(3), some(0), some(2, seed=1)], [SE3.from_xyz_yaw([5, k, 1], 0.7 * k) for k in range(3)]
    whole = TrackEstimates.concatenate(parts).transform_each(SE3Batch.of(poses), np.array([0, 0, 0, 2, 2]))
    for moved, part, pose in zip(whole.split(np.array([3, 0, 2])), parts, poses, strict=True):
        expected = part.transform(pose)
        np.testing.assert_allclose(moved.tracks.boxes.array, expected.tracks.boxes.array, atol=1e-12)
        np.testing.assert_allclose(moved.mean, expected.mean, atol=1e-12)
        np.testing.assert_allclose(moved.covariance, expected.covariance, atol=1e-12)
        assert moved.tracks.id.tolist() == part.tracks.id.tolist()


def test_there_and_back_again() -> None:
    estimates, pose = some(), SE3.from_xyz_yaw([5, -3, 1], 2.0)
    back = estimates.transform(pose).transform(pose.inverse())
    np.testing.assert_allclose(back.mean, estimates.mean)
    np.testing.assert_allclose(back.covariance, estimates.covariance)


def test_predicting_is_what_the_tracker_does() -> None:
    tracker = ab3dmot(hits=1)
    for k in range(5):
        tracker.step(cars(1.0 * k, 30.0), k * FRAME_NS)
    now = TrackEstimates(tracker.report(), ConstantVelocity.planar_covariance(tracker.reported().beliefs))
    later = tracker.predict(7 * FRAME_NS)
    predicted = ConstantVelocity().predict_estimates(now, 0.3)
    np.testing.assert_allclose(predicted.tracks.boxes.center[:, :2], later.boxes[:, :2])
    np.testing.assert_allclose(predicted.covariance, ConstantVelocity.planar_covariance(later.beliefs))
    same = ConstantVelocity().predict_estimates(now, 0.0)
    np.testing.assert_allclose(same.mean, now.mean)
    np.testing.assert_allclose(same.covariance, now.covariance)


def test_a_poses_error_shows_where_it_puts_objects() -> None:
    """Against samples: objects placed through poses that err, at heading errors of a degree."""
    estimates, rng = some(), np.random.default_rng(2)
    origin, position_noise_m, heading_noise_rad = np.array([3.0, -8.0]), 0.3, 0.0175
    offset = estimates.mean[:, :2] - origin
    turn = rng.normal(0, heading_noise_rad, (200_000, 1))
    cos, sin = np.cos(turn), np.sin(turn)
    placed = np.stack([cos * offset[:, 0] - sin * offset[:, 1], sin * offset[:, 0] + cos * offset[:, 1]], axis=-1)
    placed += rng.normal(0, position_noise_m, (len(turn), 1, 2))
    added = estimates.with_pose_noise(origin, position_noise_m, heading_noise_rad).covariance - estimates.covariance
    for k in range(len(estimates)):
        np.testing.assert_allclose(added[k, :2, :2], np.cov(placed[:, k].T), atol=0.01)
    np.testing.assert_array_equal(added[:, 2:], 0)
    np.testing.assert_array_equal(estimates.with_pose_noise(origin, 0, 0).covariance, estimates.covariance)


def test_joining_and_choosing() -> None:
    one, two = some(2, seed=1), some(3, seed=2)
    joined = TrackEstimates.concatenate([one, two])
    assert len(joined) == 5
    np.testing.assert_array_equal(joined[np.array([4])].mean, two.mean[2:])
    np.testing.assert_array_equal(joined[:2].covariance, one.covariance)


def test_a_covariance_of_another_shape_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"covariance must have shape \(2, 4, 4\), got \(2, 7, 7\)"):
        TrackEstimates(some(2).tracks, np.zeros((2, 7, 7)))
