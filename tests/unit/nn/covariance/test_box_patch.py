"""Patches are the map's features at nine places of a box, which turn with it."""

from __future__ import annotations

import numpy as np
import torch

from coopsim.nn.covariance.covariance_net import box_patches
from coopsim.types import BevGrid

GRID = BevGrid((-20.0, 20.0), (-10.0, 10.0), 0.5)


def places() -> torch.Tensor:
    """Return a map (2, h, w) whose features are x and y of the cells' centres."""
    rows, columns = GRID.shape
    x = GRID.x_m[0] + (torch.arange(columns) + 0.5) * GRID.cell_m
    y = GRID.y_m[0] + (torch.arange(rows) + 0.5) * GRID.cell_m
    return torch.stack([x.expand(rows, columns), y[:, None].expand(rows, columns)])


def test_they_are_read_at_nine_places_that_turn_with_the_box() -> None:
    box = torch.tensor([[3.0, -2.0, 0.0, 4.0, 2.0, 1.5, np.pi / 2]])
    found = box_patches(places(), box, GRID).reshape(3, 3, 2)
    np.testing.assert_allclose(found[1, 1], [3.0, -2.0], atol=1e-5)
    np.testing.assert_allclose(found[2, 1], [3.0, 1.0], atol=1e-5)  # ahead is +y, 0.75 of the length away
    np.testing.assert_allclose(found[0, 1], [3.0, -5.0], atol=1e-5)
    np.testing.assert_allclose(found[1, 0], [1.5, -2.0], atol=1e-5)  # left of +y is -x
    np.testing.assert_allclose(found[2, 2], [4.5, 1.0], atol=1e-5)


def test_beyond_the_map_there_is_nothing() -> None:
    far = torch.tensor([[100.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]])
    assert not box_patches(places(), far, GRID).any()


def test_no_boxes_have_no_patches() -> None:
    assert box_patches(places(), torch.zeros(0, 7), GRID).shape == (0, 18)
