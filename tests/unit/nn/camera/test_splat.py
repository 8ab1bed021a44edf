"""What is laid on canvases: in the right cell, of the right agent, and all of it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_cameras import AHEAD, BENT_CAMERA, CAMERAS, ROLLED, SIDEWAYS, in_mirror
from torch import Tensor

from coopsim.nn.camera.lift_splat import EXTRA, Canvas
from coopsim.nn.camera.picture_batch import PictureBatch, PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.picture_net import DepthBins
from coopsim.sensors.camera.camera import Camera
from coopsim.types import BevGrid, CameraCalibration

GRID = BevGrid((-24.0, 40.0), (-32.0, 32.0), 4.0)
MIDDLES = DepthBins(2.0, 30.0, 4).middles()
POSE = np.array([3.0, -2.0, 0.7])


def picture(calibration: CameraCalibration) -> SeenPicture:
    return SeenPicture(np.zeros((*calibration.size, 3), np.uint8), calibration)


def batch_of(*agents: tuple[Camera, ...], mirrored: bool = False) -> PictureBatch:
    pictures = ([picture(camera.calibration(1.5)) for camera in cameras] for cameras in agents)
    return collate_pictures([PictureView(each, POSE, GRID, mirrored) for each in pictures])


def canvas_of(batch: PictureBatch, features: Tensor, alpha: Tensor) -> Tensor:
    """Return the painted canvases of features (M, C, h, w) and shares of depths (M, 4, h, w) of a batch's pictures."""
    canvas, first = Canvas(batch.agents, batch.shape, features.shape[1], MIDDLES), 0
    for views in batch.views:
        group = slice(first, first := first + len(views.rgb))
        canvas.lay(views, features[group], alpha[group], MIDDLES)
    return canvas.painted()


def random_looks(count: int, channels: int = 3) -> tuple[Tensor, Tensor]:
    draws = torch.Generator().manual_seed(0)
    features = torch.randn(count, channels, 4, 6, generator=draws)
    return features, torch.randn(count, 5, 4, 6, generator=draws).softmax(1)[:, :-1]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_a_known_depth_lands_where_its_point_is(camera: Camera, mirrored: bool) -> None:
    """The way of the point is computed by hand: camera, agent, map, mirror, cell."""
    batch = batch_of((AHEAD,), (camera,), mirrored=mirrored)
    (i, j), calibration = (2, 3), camera.calibration(1.5)
    shown = 5 - j if mirrored else j  # place of the cell in the tensor
    for bin_of, depth_m in enumerate(MIDDLES.tolist()):
        alpha = torch.zeros(2, 4, 4, 6)
        alpha[1, bin_of, i, shown] = 0.5
        lens = camera.intrinsics
        middle = lens.rays.reshape(*lens.size, 3)[8 * i + 3 : 8 * i + 5, 8 * j + 3 : 8 * j + 5].mean((0, 1))
        x, y, z = calibration.base_SE3_camera.apply(depth_m * middle)
        place_x = np.cos(POSE[2]) * x - np.sin(POSE[2]) * y + POSE[0]
        place_y = np.sin(POSE[2]) * x + np.cos(POSE[2]) * y + POSE[1]
        column, row = int((place_x + 24) // 4), int(((-place_y if mirrored else place_y) + 32) // 4)
        canvas = canvas_of(batch, torch.full((2, 1, 4, 6), 8.0), alpha)
        assert canvas.abs().sum(1).nonzero().tolist() == [[1, row, column]]
        height = 0.25 * np.clip(z, -4, 12) * 0.5 / 0.8
        wanted = torch.tensor([8 * 0.5 / 0.8, np.log(1.5), height], dtype=torch.float32)
        torch.testing.assert_close(canvas[1, :, row, column], wanted, atol=2e-3, rtol=1e-3)


def test_all_that_lies_on_the_canvas_is_laid_and_nothing_else() -> None:
    batch = batch_of((AHEAD, ROLLED), (SIDEWAYS,))
    features, alpha = random_looks(3)
    alpha = alpha.where(alpha > 0.01, 0)
    canvas = canvas_of(batch, features, alpha)
    views, wanted = batch.views[0], torch.zeros(2)
    for number, depth_m in enumerate(MIDDLES):
        place = views.start[:, :2, None, None] + depth_m * views.ray[:, :2]
        inside = ((place >= 0) & (place < 16)).all(1)
        wanted.index_add_(0, views.agent, (alpha[:, number] * inside).sum((1, 2)))
    laid = canvas[:, -EXTRA].expm1().sum((1, 2))
    torch.testing.assert_close(laid, wanted, atol=1e-4, rtol=1e-4)
    assert (wanted < torch.tensor([48.0, 24.0])).all() and (wanted > 1).all()


def test_a_cell_has_the_mean_of_features_weaker_where_little_is_laid() -> None:
    batch = batch_of((AHEAD,))
    alpha = torch.zeros(1, 4, 4, 6)
    alpha[:, 1] = 0.25
    canvas = canvas_of(batch, torch.full((1, 2, 4, 6), 3.0), alpha)
    share = canvas[:, -2:-1].expm1()
    torch.testing.assert_close(canvas[:, :2], (3 * share / (share + 0.3)).expand(-1, 2, -1, -1))


def test_small_shares_are_left_out() -> None:
    assert not canvas_of(batch_of((AHEAD,)), torch.ones(1, 1, 4, 6), torch.full((1, 4, 4, 6), 0.005)).any()
    assert canvas_of(batch_of((AHEAD,)), torch.ones(1, 1, 4, 6), torch.full((1, 4, 4, 6), 0.006)).any()


def test_the_order_of_cameras_is_of_no_matter() -> None:
    order = [2, 0, 1]
    cameras, (features, alpha) = (AHEAD, BENT_CAMERA, SIDEWAYS), random_looks(3)
    one = canvas_of(batch_of(cameras), features, alpha)
    other = canvas_of(batch_of(tuple(cameras[k] for k in order)), features[order], alpha[order])
    torch.testing.assert_close(one, other)


def test_a_mirrored_view_makes_the_mirrored_canvas() -> None:
    """The grid reaches as far to the left as to the right: its mirror image has its rows in the other order."""
    cameras, (features, alpha) = (AHEAD, BENT_CAMERA, SIDEWAYS), random_looks(3)
    plain = canvas_of(batch_of(cameras), features, alpha)
    mirrored = canvas_of(batch_of(cameras, mirrored=True), features.flip(3), alpha.flip(3))
    torch.testing.assert_close(mirrored, plain.flip(2), atol=1e-4, rtol=1e-4)
    flipped = [picture(in_mirror(camera.calibration(1.5))) for camera in cameras]
    other = collate_pictures([PictureView(flipped, POSE * [1, -1, -1], GRID)])
    torch.testing.assert_close(canvas_of(other, features.flip(3), alpha.flip(3)), mirrored, atol=1e-4, rtol=1e-4)


def test_without_pictures_canvases_are_zero() -> None:
    canvas = Canvas(2, (16, 8), 3, MIDDLES).painted()
    assert canvas.shape == (2, 3 + EXTRA, 16, 8) and not canvas.any()


def test_gradients_reach_features_and_depths() -> None:
    features, alpha = (each.requires_grad_() for each in random_looks(2))
    canvas_of(batch_of((AHEAD, SIDEWAYS)), features, alpha).square().sum().backward()
    for each in (features, alpha):
        assert each.grad is not None and torch.isfinite(each.grad).all()
        assert (each.grad != 0).float().mean() > 0.5
