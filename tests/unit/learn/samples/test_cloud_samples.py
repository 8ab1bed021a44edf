"""Samples of stage A: frames, mirrors, parts, and what is labelled."""

import numpy as np
import pytest
import torch

from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.samples.cloud_samples import SampleSettings, collate_detector, detector_samples
from coopsim.learn.samples.sample_frames import boxes_in, mirror, moved, noisy, rotated, sweeps_of, tilt
from coopsim.nn.detector.decode import cell_centers
from coopsim.nn.detector.encoder import EncoderConfig
from coopsim.types import BevGrid

CORNERS = np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.4, 0.4) for z in (-0.6, 0.0, 0.6)])


def scene(count: int = 12, agents: int = 3, seed: int = 0, time_ns: int = 0) -> Scene:
    """Return a scene whose agents see small clouds of points, each in the middle of one object."""
    rng = np.random.default_rng(seed)
    boxes = np.column_stack([rng.uniform(-40, 40, (count, 2)), np.ones(count), np.tile([4.5, 1.8, 1.6], (count, 1)),
                             rng.uniform(-3, 3, count)])  # fmt: skip
    boxes[:agents, :2] = rng.uniform(-10, 10, (agents, 2))
    poses = np.column_stack([boxes[:agents, :2], np.zeros(agents), boxes[:agents, 6]])
    returns = np.where(rng.random((count, agents)) < 0.7, len(CORNERS), 0)
    returns[np.arange(agents), np.arange(agents)] = 0
    made = []
    for number, pose in enumerate(poses):
        seen = boxes[returns[:, number] > 0]
        world = (seen[:, None, :3] + CORNERS).reshape(-1, 3)
        cloud = np.column_stack([world, np.full((len(world), 2), 0.5)]).astype(np.float32)
        made.append(
            AgentScene(f"cav_{number}", "cav", pose, np.zeros(4), moved(cloud, np.zeros(4), pose)[:, :4], number)
        )
    velocity = np.column_stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])]) * 5
    return Scene(time_ns, tuple(made), np.arange(count), boxes, velocity, np.zeros(count, np.int64), returns)


def clip(frames: int = 2, agents: int = 3, dt_s: float = 0.5) -> Clip:
    return Clip("made by hand", dt_s, tuple(scene(agents=agents, seed=k) for k in range(frames)))


def test_moving_there_and_back_changes_nothing() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 20, (50, 5)).astype(np.float32)
    here, there = rng.normal(0, 10, 4), rng.normal(0, 10, 4)
    np.testing.assert_allclose(moved(moved(points, here, there), there, here), points, atol=1e-4)


def test_the_sweep_before_is_moved_by_odometry_and_has_an_age() -> None:
    standing = np.float32([[20.0, 5.0, 1.0, 0.5]])
    poses = np.array([[0.0, 0.0, 0.0, 0.3]]), np.array([[2.0, 0.5, 0.0, 0.4]])
    clouds = [moved(np.column_stack([standing, [[0.0]]]).astype(np.float32), np.zeros(4), pose[0]) for pose in poses]
    turn = poses[1][0, 3] - poses[0][0, 3]
    ahead = rotated(poses[1][:, :2] - poses[0][:, :2], -0.3)[0]
    odometry = np.array([*ahead, 0.0, turn])

    def recording(dt_ns: int) -> Clip:
        scenes = [
            Scene(k * dt_ns, (AgentScene("cav_0", "cav", pose[0], odometry, cloud[:, :4], 0),), *[np.zeros(0)] * 5)
            for k, (pose, cloud) in enumerate(zip(poses, clouds, strict=True))
        ]
        return Clip("standing", dt_ns / 1e9, tuple(scenes))

    both = sweeps_of(recording(100_000_000), 1, 0, 2)
    np.testing.assert_allclose(both[0, :4], both[1, :4], atol=1e-4)
    np.testing.assert_allclose(both[:, 4], [0.0, 0.1], atol=1e-6)
    assert len(sweeps_of(recording(100_000_000), 0, 0, 2)) == 1
    assert len(sweeps_of(recording(500_000_000), 1, 0, 2)) == 1


def test_points_of_an_object_stay_in_its_box_in_any_frame() -> None:
    boxes = np.array([[30.0, -20.0, 1.0, 4.0, 2.0, 1.5, 0.8]])
    pose, frame = np.array([10.0, 5.0, 0.2, 1.1]), np.array([-3.0, 2.0, 0.1, -2.0])
    point = moved(np.float32([[30, -20, 1, 0, 0]]), np.zeros(4), pose)
    placed, velocity = boxes_in(boxes, np.array([[np.cos(0.8), np.sin(0.8)]]), frame)
    np.testing.assert_allclose(moved(point, pose, frame)[0, :3], placed[0, :3], atol=1e-4)
    np.testing.assert_allclose(velocity[0], [np.cos(placed[0, 6]), np.sin(placed[0, 6])], atol=1e-9)


def test_a_mirror_turns_points_boxes_and_velocities_alike() -> None:
    points, boxes = np.float32([[1, 2, 3, 0.5, 0]]), np.array([[1.0, 2.0, 3.0, 4.0, 2.0, 1.5, 0.5]])
    velocity = np.array([[np.cos(0.5), np.sin(0.5)]])
    mirror(points, boxes, velocity)
    np.testing.assert_allclose(points[0, :3], boxes[0, :3])
    np.testing.assert_allclose(velocity[0], [np.cos(boxes[0, 6]), np.sin(boxes[0, 6])])


@pytest.mark.parametrize("merged", [0.0, 1.0])
@pytest.mark.parametrize("mirrored", [0.0, 1.0])
def test_targets_lie_on_points_and_unseen_objects_are_no_targets(merged: float, mirrored: float) -> None:
    settings = SampleSettings(merged=merged, mirrored=mirrored, thinned=0.0, crop_cells=None, dropout=0.0)
    samples = detector_samples(clip(), np.random.default_rng(1), settings)
    assert sum(sample.targets.objects for sample in samples) > 1
    for sample in samples:
        targets = sample.targets
        grid = BevGrid((-76.8, 76.8), (-76.8, 76.8), 1.2)
        centre = cell_centers(targets.cell, grid) + targets.code[:, :2] * 1.2
        rows, columns = np.divmod(sample.pillars.cell, sample.pillars.shape[1])
        filled = torch.tensor(np.column_stack([columns, rows]) * 0.6 - 76.5)
        assert (torch.cdist(centre.double(), filled).amin(1) < 1.0).all()
        assert (torch.cdist(filled, centre.double()).amin(1) < 1.5).all()
        if merged == 0:
            assert targets.objects <= 11  # never the agent itself


def test_parts_have_one_shape_and_batches_join_them() -> None:
    samples = detector_samples(clip(), np.random.default_rng(1), SampleSettings(crop_cells=64))
    assert len(samples) == 6
    batch = collate_detector(samples)
    assert batch.pillars.shape == (64, 64)
    assert batch.targets.heat.shape == (6, 9, 32, 32)


def test_the_same_stream_draws_the_same_samples() -> None:
    one, other = (detector_samples(clip(), np.random.default_rng(5), SampleSettings()) for _ in range(2))
    assert one
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.pillars.features, b.pillars.features)


def test_noise_has_the_stated_size() -> None:
    rng = np.random.default_rng(0)
    errors = np.array([noisy(np.zeros(4), rng, 0.4, 0.01) for _ in range(4000)])
    np.testing.assert_allclose(errors.std(axis=0), [0.4, 0.4, 0.0, 0.01], rtol=0.05)


def thinner(points: int) -> Clip:
    """Return a clip of a car whose agent has so many points on it above the ground."""
    car = np.array([[20.0, 5.0, 0.8, 4.5, 1.8, 1.6, 0.3]])
    own = np.array([[0.0, 0.0, 0.8, 4.5, 1.8, 1.6, 0.0]])
    cloud = np.float32([[20.0 + 0.1 * k, 5.0, 1.0, 0.5] for k in range(points)] + [[20.0, 5.0, 0.05, 0.5]] * 5)
    agent = AgentScene("cav_0", "cav", np.zeros(4), np.zeros(4), cloud, 1)
    returns = np.array([[0], [points + 5]])
    made = Scene(0, (agent,), np.array([1, 2]), np.concatenate([own, car]), np.zeros((2, 2)), np.zeros(2, int), returns)
    return Clip("thin", 1.0, (made,))


@pytest.mark.parametrize(("points", "taught", "left_open"), [(5, 1, False), (2, 0, True), (0, 0, False)])
def test_objects_are_taught_by_the_points_that_are_left(points: int, taught: int, left_open: bool) -> None:
    settings = SampleSettings(thinned=0.0, merged=0.0, crop_cells=None)
    (sample,) = detector_samples(thinner(points), np.random.default_rng(0), settings)
    assert sample.targets.objects == taught
    assert bool(sample.targets.ignored.any()) == left_open


def test_two_sweeps_tell_how_objects_move_and_one_does_not() -> None:
    settings = SampleSettings(thinned=0.0, merged=0.0, single=0.5, crop_cells=None)
    scenes = tuple(scene(seed=0, time_ns=k * 100_000_000) for k in range(12))
    samples = detector_samples(Clip("pairs", 0.1, scenes), np.random.default_rng(0), settings, EncoderConfig(sweeps=2))
    aged = [bool((sample.pillars.features[:, 8] > 0).any()) for sample in samples]
    assert 0 < sum(aged) < len(aged) - 3
    for sample, two in zip(samples, aged, strict=True):
        assert (sample.targets.moves == float(two)).all()


def test_points_and_boxes_tilt_together_and_only_where_asked_for() -> None:
    points = np.float32([[20.0, 5.0, 1.0, 0.5, 0.0], [-30.0, 8.0, 0.0, 0.5, 0.0]])
    boxes = np.array([[20.0, 5.0, 1.0, 4.0, 2.0, 1.5, 0.3]])
    tilt(points, boxes, np.array([0.02, -0.01]))
    assert points[:, 2] == pytest.approx([1.35, -0.68]) and boxes[0, 2] == pytest.approx(1.35)
    level, tilted = (
        detector_samples(clip(1), np.random.default_rng(0), SampleSettings(tilt_deg=tilt_deg))
        for tilt_deg in (0.0, 2.0)
    )
    heights = [[sample.targets.code[:, 2] for sample in samples] for samples in (level, tilted)]
    assert any(
        one.shape != other.shape or (one - other).abs().max() > 0.05 for one, other in zip(*heights, strict=True)
    )
