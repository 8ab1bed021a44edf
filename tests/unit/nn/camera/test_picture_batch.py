"""Pictures as tensors: the same space on any canvas, in a mirror, and in groups."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from small_cameras import AHEAD, BENT_CAMERA, CAMERAS, PARTIAL, SIDEWAYS, in_mirror

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.picture_batch import CameraViews, PictureView, SeenPicture, by_size, cell_rays, collate_pictures
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import BevGrid

GRID = BevGrid((-12.0, 20.0), (-16.0, 16.0), 2.0)
POSE = np.array([1.5, -0.7, 0.8])


def seen(camera: Camera, seed: int = 0) -> SeenPicture:
    rgb = np.random.default_rng(seed).integers(0, 256, (*camera.intrinsics.size, 3), dtype=np.uint8)
    return SeenPicture(rgb, camera.calibration(1.5))


def views_of(view: PictureView) -> CameraViews:
    (views,) = collate_pictures([view]).views
    return views


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_lines_of_sight_are_moved_to_the_canvas(camera: Camera) -> None:
    picture = seen(camera)
    views, sight = views_of(PictureView([picture], POSE, GRID)), cell_rays(picture.calibration)
    x, y, yaw = POSE
    for depth_m in (0.0, 7.0):
        base = sight.start_m[:, None, None] + depth_m * sight.ray
        on_map = [
            np.cos(yaw) * base[0] - np.sin(yaw) * base[1] + x,
            np.sin(yaw) * base[0] + np.cos(yaw) * base[1] + y,
        ]
        wanted = np.stack([(on_map[0] + 12) / 2, (on_map[1] + 16) / 2, base[2]])
        found = views.start[0, :, None, None] + depth_m * views.ray[0]
        np.testing.assert_allclose(found, wanted, atol=1e-4)


@pytest.mark.parametrize("camera", [AHEAD, SIDEWAYS, BENT_CAMERA], ids=lambda camera: camera.name)
def test_a_mirrored_view_is_the_view_of_a_mirrored_world(camera: Camera) -> None:
    picture = seen(camera)
    points_m = np.random.default_rng(1).uniform([-20, -20, 0], [20, 20, 3], (300, 3))
    world = PictureView([picture], POSE, GRID, mirrored=True, points_m=points_m)
    flipped = SeenPicture(picture.rgb[:, ::-1], in_mirror(picture.calibration))
    other = PictureView([flipped], POSE * [1, -1, -1], GRID, points_m=points_m * [1, -1, 1])
    one, two = views_of(world), views_of(other)
    assert torch.equal(one.rgb, two.rgb)
    assert (one.measured_m > 0).sum() > 3
    for name in ("geometry", "start", "ray", "measured_m"):
        torch.testing.assert_close(getattr(one, name), getattr(two, name), atol=1e-4, rtol=1e-4)


def test_pictures_of_as_many_cells_are_in_one_group_and_know_their_agents() -> None:
    small = Camera("small", Intrinsics.from_fov(24, 16))
    agents = [
        PictureView([seen(AHEAD, 1), seen(small, 2)], POSE, GRID),
        PictureView([], POSE, GRID),
        PictureView([seen(PARTIAL, 3)], np.zeros(3), GRID),
    ]
    assert by_size(agents) == [[(0, 0), (2, 0)], [(0, 1)]]
    batch = collate_pictures(agents)
    assert (batch.agents, batch.shape) == (3, (16, 16))
    assert [views.agent.tolist() for views in batch.views] == [[0, 2], [0]]
    assert [tuple(views.rgb.shape) for views in batch.views] == [(2, 3, 32, 48), (1, 3, 16, 24)]
    rgb = batch.views[0].rgb[1].permute(1, 2, 0)
    assert torch.equal(rgb[:27, :44], torch.from_numpy(agents[2].pictures[0].rgb))
    assert not rgb[27:].any() and not rgb[:, 44:].any()


def test_without_pictures_a_batch_has_agents_and_a_shape_only() -> None:
    batch = collate_pictures([PictureView([], POSE, GRID)] * 2)
    assert (batch.views, batch.agents, batch.shape) == ((), 2, (16, 16))
    assert batch.to("cpu").views == ()


def test_without_points_nothing_is_measured() -> None:
    for points_m in (None, np.zeros((0, 3))):
        assert not views_of(PictureView([seen(AHEAD)], POSE, GRID, points_m=points_m)).measured_m.any()


def in_two_shapes(view: PictureView) -> list[PictureView]:
    return [view, replace(view, grid=BevGrid((-8.0, 8.0), (-16.0, 16.0), 2.0))]


@pytest.mark.parametrize(
    ("views", "match"),
    [
        (lambda view: [], "canvases of one shape, got no agent"),
        (in_two_shapes, r"canvases of one shape, got \[\(16, 8\), \(16, 16\)\]"),
        (lambda view: [of_rgb(view, view.pictures[0].rgb[:-1])], r"size \(32, 48\), got \(31, 48, 3\) uint8"),
        (lambda view: [of_rgb(view, view.pictures[0].rgb / 255)], r"uint8 of its camera's size.*48, 3\) float64"),
        (lambda view: [replace(view, points_m=np.zeros((5, 4)))], r"points_m must have shape \(N, 3\)"),
    ],
)
def test_bad_pictures_are_refused(views: Any, match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        collate_pictures(views(PictureView([seen(AHEAD)], POSE, GRID)))


def of_rgb(view: PictureView, rgb: np.ndarray) -> PictureView:
    return replace(view, pictures=[SeenPicture(rgb, view.pictures[0].calibration)])
