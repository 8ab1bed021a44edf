"""Samples of pictures: what they show is what is to be found, in a mirror, too."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from pictured_clips import RIG, PicturedClips, photograph
from small_cameras import BENT

from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.picture_samples import PictureSample, collate_picture_samples, picture_samples
from coopsim.nn.detector.decode import cell_centers
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.projection import project
from coopsim.types import ObjectClass

CELL_M = 2.4
SETTINGS = SampleSettings(reach_m=19.2, crop_cells=8, mirrored=0.5, thinned=0.0, merged=0.0)
WHOLE_MAP = replace(SETTINGS, crop_cells=None)
NOTHING = 255
WIDE = (
    Camera("ahead", Intrinsics.from_fov(96, 64), pitch_rad=0.1),
    Camera("left", Intrinsics.from_fov(92, 60, distortion=BENT), yaw_rad=1.6, pitch_rad=0.1),
    Camera("back", Intrinsics.from_fov(96, 64), yaw_rad=-2.9, pitch_rad=0.1),
)


@cache
def clip() -> Clip:
    return PicturedClips(objects=6, rig=WIDE).clip(0)


def one_van(x_m: float, y_m: float, pose: np.ndarray, camera: Camera) -> Clip:
    """Return a clip of an agent at a pose, with one camera, and a van at a place relative to the agent."""
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    place = pose[:2] + np.array([cos * x_m - sin * y_m, sin * x_m + cos * y_m])
    boxes = np.array([[*place, 1.5, 6.0, 2.5, 3.0, pose[3] + 0.3]])
    agent = AgentScene("cav_0", "cav", pose, np.zeros(4), np.zeros((0, 4), np.float32), None)
    label = np.array([int(ObjectClass.VAN)])
    picture, pixels = photograph(camera, agent, boxes, label)
    returns = np.zeros((1, 1), np.int64)
    agents = (replace(agent, pictures=(picture,)),)
    return Clip(
        "one van", 0.1, (Scene(0, agents, np.arange(1), boxes, np.zeros((1, 2)), label, returns, pixels[:, None]),)
    )


def draw(seed: int = 0, settings: SampleSettings = SETTINGS, **options: bool) -> list[PictureSample]:
    drawn = picture_samples(clip(), np.random.default_rng(seed), settings, CELL_M, **options)
    assert drawn
    return drawn


def in_base(sample: PictureSample) -> np.ndarray:
    """Return the places (M, 2) of a sample's targets in its agent's base frame."""
    grid = sample.view.grid.coarser(2)
    places = (cell_centers(sample.targets.cell, grid) + sample.targets.code[:, :2] * grid.cell_m).numpy()
    if sample.view.mirrored:
        places = places * [1, -1]
    x, y, yaw = sample.view.map_SE2_base
    dx, dy = (places - [x, y]).T
    return np.column_stack([np.cos(yaw) * dx + np.sin(yaw) * dy, -np.sin(yaw) * dx + np.cos(yaw) * dy])


def test_each_agent_with_pictures_has_a_sample_in_each_scene() -> None:
    assert len(draw()) == 4
    (first, second), rest = clip().scenes[0].agents, clip().scenes[1:]
    blind = replace(clip().scenes[0], agents=(replace(first, pictures=()), second))
    assert len(picture_samples(replace(clip(), scenes=(blind, *rest)), np.random.default_rng(0), SETTINGS, CELL_M)) == 3


def test_one_two_or_all_cameras_are_taken_each_at_most_once() -> None:
    seen = {len(sample.view.pictures) for seed in range(8) for sample in draw(seed)}
    assert seen == {1, 2, 3}
    for sample in draw(3):
        ids = [id(picture.calibration) for picture in sample.view.pictures]
        assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("points", [False, True])
def test_the_same_stream_draws_the_same_pictures(points: bool) -> None:
    for one, other in zip(draw(5, points=points), draw(5, points=points), strict=True):
        for mine, yours in zip(one.view.pictures, other.view.pictures, strict=True):
            np.testing.assert_array_equal(mine.rgb, yours.rgb)
        np.testing.assert_array_equal(one.view.map_SE2_base, other.view.map_SE2_base)
        assert (one.view.grid, one.view.mirrored) == (other.view.grid, other.view.mirrored)
        assert torch.equal(one.targets.heat, other.targets.heat) and torch.equal(one.targets.code, other.targets.code)
    assert any((a.view.map_SE2_base != b.view.map_SE2_base).any() for a, b in zip(draw(5), draw(6), strict=True))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("camera", "place"), [(0, (12.0, 7.0)), (1, (-6.0, 11.0)), (2, (-12.0, 5.0))])
def test_a_target_is_found_in_the_picture_at_its_place(camera: int, place: tuple[float, float], mirrored: bool) -> None:
    """The target of the map, moved back by hand, projects into a cell that has the object's class and depth."""
    seen = one_van(*place, np.array([30.0, -12.0, 0.0, 0.7]), WIDE[camera])
    settings = replace(WHOLE_MAP, mirrored=float(mirrored))
    (sample,) = picture_samples(seen, np.random.default_rng(3), settings, CELL_M)
    assert (sample.view.mirrored, sample.targets.objects) == (mirrored, 1)
    np.testing.assert_allclose(in_base(sample), [place] * len(sample.targets.cell), atol=0.01)
    projected = project(sample.view.pictures[0].calibration, np.array([[*place, 1.5]]))
    column, row = ((projected.place_px[0] + 0.5) // 8).astype(int)
    depth_m, label = sample.depth_m[0], sample.label[0]
    assert (label == ObjectClass.VAN).mean() < 0.5
    (views,) = collate_picture_samples([sample]).pictures.views
    assert depth_m.shape == label.shape == views.geometry.shape[-2:]
    column = label.shape[1] - 1 - column if mirrored else column
    assert label[row, column] == ObjectClass.VAN != label[row, -1 - column]
    assert 0 < projected.depth_m[0] - depth_m[row, column] < 3.5  # from its surface to its middle
    laid = views.start[0] + projected.depth_m[0] * views.ray[0, :, row, column]
    cell = divmod(int(sample.targets.cell[sample.targets.weight.argmax()]), 8)  # of the map, half as fine as the canvas
    np.testing.assert_allclose(laid[[1, 0]] / 2, np.array(cell) + 0.5, atol=0.9)


def test_targets_are_objects_with_enough_pixels_whose_middle_a_chosen_camera_has() -> None:
    told = [0, 0]
    for seed in range(6):
        for number, sample in enumerate(draw(seed, replace(WHOLE_MAP, mirrored=0.0))):
            scene, member = clip().scenes[number // 2], number % 2
            agent = scene.agents[member]
            pose = agent.xyz_yaw
            turn = np.array([[np.cos(pose[3]), np.sin(pose[3])], [-np.sin(pose[3]), np.cos(pose[3])]])
            middles = np.column_stack([(scene.boxes[:, :2] - pose[:2]) @ turn.T, scene.boxes[:, 2]])
            in_picture = np.any([project(each.calibration, middles).inside for each in sample.view.pictures], axis=0)
            assert scene.pixels is not None
            wanted = in_picture & (scene.pixels[:, member] >= 16)
            near = np.abs(in_base(sample)[:, None] - middles[None, :, :2]).max(-1) < 0.05
            assert near.any(1).all()
            assert not near[:, ~wanted].any()
            told[0] += int(wanted.sum())
            told[1] += sample.targets.objects
    assert 0.5 * told[0] < told[1] <= told[0]  # some lie outside of a turned map


def test_points_make_targets_of_what_they_show_and_measure_depths() -> None:
    for plain, with_points in zip(draw(1, WHOLE_MAP), draw(1, WHOLE_MAP, points=True), strict=True):
        assert plain.view.points_m is None
        assert with_points.targets.objects >= plain.targets.objects
        assert with_points.view.points_m is not None
    own = draw(1, points=True)[0].view.points_m
    merged = draw(1, replace(SETTINGS, merged=1.0, dropout=0.0), points=True)[0].view.points_m
    agents = clip().scenes[0].agents
    assert own is not None
    np.testing.assert_allclose(own, agents[0].points[:, :3], atol=1e-4)
    assert merged is not None and len(merged) == sum(len(agent.points) for agent in agents)
    heights = np.abs(merged[len(agents[0].points) :, 2])
    np.testing.assert_allclose(heights, np.abs(agents[1].points[:, 2]), atol=1e-5)
    # Both agents see the same boxes and ground, so points of one lie near points of the other.
    others = torch.from_numpy(merged[len(agents[0].points) :][:240])
    assert torch.cdist(others, torch.from_numpy(own[:240])).amin(1).median() < 0.5


def test_points_of_others_are_in_the_map_as_well() -> None:
    settings = replace(WHOLE_MAP, dropout=0.0, thinned=0.0, mirrored=0.0)
    counts = [
        [int(each.pillars.count.sum()) for each in draw(3, replace(settings, merged=merged), points=True)]
        for merged in (0.0, 1.0)
    ]
    assert sum(counts[1]) > 1.3 * sum(counts[0])


def test_whole_samples_have_all_pictures_as_they_are_on_the_whole_map() -> None:
    for number, sample in enumerate(draw(2, replace(SETTINGS, mirrored=1.0), whole=True)):
        agent = clip().scenes[number // 2].agents[number % 2]
        assert not sample.view.mirrored and sample.view.grid.shape == (16, 16)
        assert len(sample.view.pictures) == 3
        for mine, picture in zip(sample.view.pictures, agent.pictures, strict=True):
            assert mine.rgb is picture.rgb and mine.calibration is picture.calibration


def test_cells_have_the_nearest_surface_of_their_blocks_and_its_class() -> None:
    (sample, *_), agent = draw(2, whole=True), clip().scenes[0].agents[0]
    assert len(agent.pictures) == 3
    for depth_m, label, picture in zip(sample.depth_m, sample.label, agent.pictures, strict=True):
        blocks = picture.depth_m.astype(np.float32)
        for row in range(depth_m.shape[0]):
            for column in range(depth_m.shape[1]):
                square = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
                there = blocks[square][blocks[square] > 0]
                assert depth_m[row, column] == (there.min() if len(there) else 0)
                nearest = picture.label[square][blocks[square] == depth_m[row, column]]
                assert label[row, column] in nearest
        assert ((label != NOTHING) <= (depth_m > 0)).all()
        assert (label != NOTHING).any() or (picture.label == NOTHING).all()


def test_light_changes_pictures_alone() -> None:
    for sample in draw(4, replace(WHOLE_MAP, mirrored=0.0)):
        assert all(picture.rgb.dtype == np.uint8 for picture in sample.view.pictures)
    (one, *_), agent = draw(4, replace(WHOLE_MAP, mirrored=0.0)), clip().scenes[0].agents[0]
    true = next(each for each in agent.pictures if each.calibration is one.view.pictures[0].calibration)
    ratio = one.view.pictures[0].rgb[true.rgb > 50] / true.rgb[true.rgb > 50]
    assert ratio.min() > 0.6 and ratio.max() < 1.6 and abs(ratio.mean() - 1) > 0.01


def test_parts_are_around_objects_and_inside_the_map() -> None:
    for seed in range(4):
        for sample in draw(seed):
            grid = sample.view.grid
            assert grid.shape == (8, 8)
            assert all(-19.2001 <= low < high <= 19.2001 for low, high in (grid.x_m, grid.y_m))


def test_batches_have_depths_and_classes_in_the_groups_of_pictures() -> None:
    samples = picture_samples(PicturedClips(rig=RIG).clip(0), np.random.default_rng(1), SETTINGS, CELL_M)
    batch = collate_picture_samples(samples)
    assert batch.pictures.agents == batch.pillars.clouds == len(batch.targets.heat) == len(samples) == 4
    assert len(batch.pictures.views) >= 1
    for views, depth_m, label in zip(batch.pictures.views, batch.depth_m, batch.label, strict=True):
        assert depth_m.shape == label.shape == views.measured_m.shape
        assert depth_m.dtype == torch.float32 and label.dtype == torch.uint8
    first = samples[0]
    assert any(torch.equal(one, torch.from_numpy(first.depth_m[0])) for one in batch.depth_m[0])
