"""Anchors are at the middles of cells, and codes can be read back."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.anchors import AnchorConfig, anchor_boxes, decode_relative, encode_relative, turn_to_side
from coopsim.types import BevGrid


def random_boxes(count: int, seed: int = 0) -> Floats:
    rng = np.random.default_rng(seed)
    at = rng.uniform((-40, -40, 0), (40, 40, 2), (count, 3))
    return np.column_stack([at, rng.uniform(0.3, 14, (count, 3)), rng.uniform(-np.pi, np.pi, count)])


def test_codes_of_all_sizes_and_headings_can_be_read_back() -> None:
    boxes = torch.from_numpy(random_boxes(500))
    anchors = torch.from_numpy(random_boxes(500, 1))
    np.testing.assert_allclose(decode_relative(encode_relative(boxes, anchors), anchors), boxes, atol=1e-9)


def test_the_code_counts_in_diagonals_heights_and_ratios() -> None:
    anchor = torch.tensor([[10.0, 5, 1, 3, 4, 2, 0.5]])
    box = torch.tensor([[15.0, 0, 2, 3 * math.e, 4, 2 / math.e, 0.75]])
    assert encode_relative(box, anchor)[0].tolist() == pytest.approx([1, -1, 0.5, 1, 0, -1, 0.25], abs=1e-6)


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_anchors_are_at_the_middles_of_cells_at_any_stride(factor: int) -> None:
    grid = BevGrid((-12.0, 24.0), (-4.8, 4.8), 0.6).coarser(factor)
    rows, columns = grid.shape
    boxes = anchor_boxes(grid, AnchorConfig()).reshape(2, rows, columns, 7)
    for i, j in ((0, 0), (rows - 1, columns - 1), (1, 3)):
        assert boxes[0, i, j, 0] == pytest.approx(-12 + (j + 0.5) * grid.cell_m)
        assert boxes[1, i, j, 1] == pytest.approx(-4.8 + (i + 0.5) * grid.cell_m)
    assert boxes[..., 0].mean() == pytest.approx(6)  # not off by part of a cell
    assert np.unique(boxes[1, :, :, 6]).tolist() == [math.pi / 2]


def test_some_anchors_are_those_of_all() -> None:
    grid, config = BevGrid((0.0, 6.0), (0.0, 4.0), 1.0), AnchorConfig(yaw_rad=(0.0, 0.7, 1.4))
    index = np.array([71, 0, 30])
    np.testing.assert_array_equal(anchor_boxes(grid, config, index), anchor_boxes(grid, config)[index])


def test_a_heading_is_turned_to_the_side_it_looks_to() -> None:
    turn = torch.linspace(-9, 9, 200, dtype=torch.float64)
    for backwards in (False, True):
        turned = turn_to_side(turn, torch.full((200,), backwards))
        assert torch.equal(torch.cos(turned) < 0, torch.full((200,), backwards))
        assert torch.sin(turned - turn).abs().max() < 1e-9  # the axis is as it was


@pytest.mark.parametrize("wrong", [{"size_m": (4, 2, 0)}, {"size_m": (4, 2)}, {"yaw_rad": ()}, {"z_m": math.nan}])
def test_wrong_anchors_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InvalidValueError):
        AnchorConfig(**wrong)  # type: ignore[arg-type]
