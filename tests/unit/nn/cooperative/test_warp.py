"""Warp: places are where they should be, for any grids and turns."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.cooperative import warp as module  # noqa: E402
from coopsim.nn.cooperative.warp import placing, warp  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
SOURCE = BevGrid((-12.0, 24.0), (-18.0, 6.0), 1.2)
TARGET = BevGrid((-20.4, 15.6), (-9.6, 14.4), 1.2)


def ramps(grid: BevGrid) -> torch.Tensor:
    """Return a map (1, 2, h, w) of which each cell holds its own centre's coordinates."""
    return torch.from_numpy(grid.cell_centers()).permute(2, 0, 1)[None].float()


def moved(grid: BevGrid, pose: tuple[float, float, float]) -> np.ndarray:
    """Return the centres of a grid's cells, (2, H, W), moved by a pose x, y, yaw."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = np.moveaxis(grid.cell_centers(), -1, 0)
    return np.stack([cos * x - sin * y + pose[0], sin * x + cos * y + pose[1]])


POSES = [
    (x, y, math.radians(yaw))
    for yaw in (0.0, 0.05, 30.0, 90.0, 180.0, -121.0)
    for x, y in ((0.0, 0.0), (3.7, -2.9), (1.2, -2.4))
]


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("target", [TARGET, SOURCE, BevGrid((-7.0, 9.0), (-9.0, 5.0), 0.5)])
def test_coordinates_are_transformed(target: BevGrid, pose: tuple[float, float, float]) -> None:
    values, valid = warp(ramps(SOURCE), SOURCE, target, [pose])
    truth = moved(target, pose)
    (left, right), (low, high) = SOURCE.x_m, SOURCE.y_m
    margin = SOURCE.cell_m / 2
    off = np.stack([left + margin - truth[0], truth[0] - right + margin, low + margin - truth[1]])
    off = np.maximum(off.max(0), truth[1] - high + margin)  # m beyond the outermost cell centres
    assert valid[0][torch.from_numpy(off < -1e-3)].all() and not valid[0][torch.from_numpy(off > 1e-3)].any()
    assert valid.any()
    error = (values[0] - torch.from_numpy(truth)).abs().amax(0)
    assert error[valid[0]].max() < 1e-3
    assert not values[0, :, ~valid[0]].any()


def test_the_same_grid_and_pose_copy_exactly() -> None:
    image = torch.randn(2, 3, *SOURCE.shape, generator=torch.Generator().manual_seed(1))
    values, valid = warp(image, SOURCE, SOURCE, np.zeros((2, 3)))
    assert torch.equal(values, image) and valid.all()


def test_a_shift_by_whole_cells_copies_exactly() -> None:
    image = torch.randn(1, 3, *SOURCE.shape, generator=torch.Generator().manual_seed(1))
    place = BevGrid((-18.0, 42.0), (-30.0, 18.0), 1.2)
    values, valid = warp(image, SOURCE, place, [(-1.2, 2.4, 0.0)])
    rows, columns = SOURCE.shape
    top, left = 10 - 2, 5 + 1
    assert torch.equal(values[:, :, top : top + rows, left : left + columns], image)
    assert int(valid.sum()) == rows * columns


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.6, 0.6), (3.7, -2.9), (-8.11, 4.0001), (0.3, 2.4), (33.0, 0.0)])
def test_shifts_equal_the_general_way(shift: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    image = torch.randn(1, 4, *SOURCE.shape, generator=torch.Generator().manual_seed(1))
    pose = [(*shift, 0.0)]
    fast, fast_valid = warp(image, SOURCE, TARGET, pose)
    monkeypatch.setattr(module, "_shifted", module._sampled)
    general, valid = warp(image, SOURCE, TARGET, pose)
    assert torch.equal(fast_valid, valid) and valid.any()
    assert (fast - general).abs().max() < 1e-5


def test_maps_far_away_give_nothing() -> None:
    values, valid = warp(torch.ones(2, 1, *SOURCE.shape), SOURCE, TARGET, [(500.0, 0.0, 0.0), (0.0, -90.0, 1.0)])
    assert not values.any() and not valid.any()
    values, valid = warp(torch.ones(0, 5, *SOURCE.shape), SOURCE, TARGET, np.zeros((0, 3)))
    assert values.shape == (0, 5, *TARGET.shape) and valid.shape == (0, *TARGET.shape)


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_cells_that_were_not_sent_take_no_part(yaw: float) -> None:
    pose = [(0.5, -0.4, yaw)]
    image = torch.full((1, 2, *SOURCE.shape), 7.0)
    present = torch.rand(1, *SOURCE.shape, generator=torch.Generator().manual_seed(1)) < 0.4
    image = torch.where(present[:, None], image, -1000.0)
    values, valid = warp(image, SOURCE, TARGET, pose, present)
    assert 0 < int(valid.sum()) < valid.numel()
    seen = values[:, :, valid[0]]
    assert torch.allclose(seen, torch.full_like(seen, 7.0), atol=1e-3)
    assert not values[:, :, ~valid[0]].any()
    everything = torch.ones_like(present)
    assert torch.equal(warp(image, SOURCE, TARGET, pose, everything)[1], warp(image, SOURCE, TARGET, pose)[1])


@pytest.mark.parametrize("shift", [(0.6, 0.6), (0.1, 0.7), (0.59, 0.61)])
def test_a_lone_cell_is_never_lost(shift: tuple[float, float]) -> None:
    present = torch.zeros(1, *SOURCE.shape, dtype=torch.bool)
    present[0, 12, 14] = True
    _, valid = warp(torch.ones(1, 1, *SOURCE.shape), SOURCE, TARGET, [(*shift, 0.0)], present)
    assert 1 <= int(valid.sum()) <= 4


@pytest.mark.parametrize("pose", [(0.5, -0.4, 0.0), (1.2, 0.0, 0.0), (0.5, -0.4, 2.0)])
def test_gradients_reach_the_maps(pose: tuple[float, float, float]) -> None:
    image = torch.randn(1, 2, *SOURCE.shape, generator=torch.Generator().manual_seed(1)).requires_grad_()
    values, valid = warp(image, SOURCE, TARGET, [pose])
    values.sum().backward()
    assert image.grad is not None and image.grad.isfinite().all()
    assert image.grad.sum().item() == pytest.approx(2 * float(valid.sum()), rel=1e-3)


def test_low_precision_is_kept() -> None:
    image = torch.ones(1, 2, *SOURCE.shape, dtype=torch.bfloat16)
    for yaw in (0.0, 0.3):
        assert warp(image, SOURCE, TARGET, [(0.5, 0.0, yaw)])[0].dtype == torch.bfloat16


def test_what_does_not_fit_is_refused() -> None:
    image = torch.ones(1, 2, *SOURCE.shape)
    with pytest.raises(InvalidValueError, match="maps must be floats of shape"):
        warp(image, BevGrid((0.0, 12.0), (0.0, 12.0), 1.2), TARGET, [(0.0, 0.0, 0.0)])
    with pytest.raises(InvalidValueError, match="must be 1 finite poses"):
        warp(image, SOURCE, TARGET, [(0.0, math.nan, 0.0)])
    with pytest.raises(InvalidValueError, match="must be 1 finite poses"):
        warp(image, SOURCE, TARGET, np.zeros((2, 3)))
    with pytest.raises(InvalidValueError, match="present must be bool"):
        warp(image, SOURCE, TARGET, [(0.0, 0.0, 0.0)], torch.ones(1, *SOURCE.shape))


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_the_layout_in_memory_is_kept_and_without_effect(yaw: float) -> None:
    image = torch.randn(2, 3, *SOURCE.shape, generator=torch.Generator().manual_seed(1))
    last = image.contiguous(memory_format=torch.channels_last)
    poses = [(0.5, -0.4, yaw), (3.0, 1.0, yaw)]
    values, _ = warp(last, SOURCE, TARGET, poses)
    assert values.is_contiguous(memory_format=torch.channels_last)
    assert torch.allclose(values, warp(image, SOURCE, TARGET, poses)[0], atol=1e-6)


def test_cells_are_as_far_from_their_sender_and_as_wrongly_placed_as_its_heading_moves_them() -> None:
    pose, turn = (5.0, -3.0, 0.4), 0.02
    error_m, range_m = placing(TARGET, [pose], [(0.3, turn)])
    np.testing.assert_allclose(range_m[0], np.hypot(*moved(TARGET, pose)), rtol=1e-5)
    np.testing.assert_allclose(error_m[0], np.hypot(0.3, turn * np.hypot(*moved(TARGET, pose))), rtol=1e-5)
