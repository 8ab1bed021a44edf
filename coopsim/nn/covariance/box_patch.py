"""What an agent's own map of features shows around a box, for a network that judges how exact the box is."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.types import BevGrid

PLACES = 3
"""Places along the length, and across the width, of a box at which the map is read."""

_REACH = 0.75  # of length and width, from the box's middle: the outer places are beyond its sides


def box_patches(features: Tensor, boxes: Tensor, grid: BevGrid) -> Tensor:
    """Return the features (N, 9 C) at 3 x 3 places in and around boxes, row by row from the left of the back.

    The places turn with the box, as in the source the patch does not: so an object looks the same whatever its heading.
    Between cells features are interpolated; beyond the map they are zero.

    Args:
        features: (C, h, w), y along h and x along w.
        boxes: (N, 7) x, y, z, l, w, h, yaw in the frame of the grid.
        grid: the cells of the features.
    """
    steps = torch.linspace(-_REACH, _REACH, PLACES, dtype=features.dtype, device=features.device)
    boxes = boxes.to(features)
    ahead, left = (each.flatten() for each in torch.meshgrid(steps, -steps, indexing="ij"))
    ahead, left = boxes[:, 3:4] * ahead, boxes[:, 4:5] * left
    cos, sin = boxes[:, 6:7].cos(), boxes[:, 6:7].sin()
    x, y = boxes[:, 0:1] + cos * ahead - sin * left, boxes[:, 1:2] + sin * ahead + cos * left
    (x_low, x_high), (y_low, y_high) = grid.x_m, grid.y_m
    places = torch.stack([2 * (x - x_low) / (x_high - x_low) - 1, 2 * (y - y_low) / (y_high - y_low) - 1], dim=-1)
    found = functional.grid_sample(features[None], places[None], align_corners=False)  # (1, C, N, 9)
    return found[0].permute(1, 2, 0).flatten(1)
