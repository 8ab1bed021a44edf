"""The centre head: boxes as points on a map (CenterPoint, Yin et al., CVPR 2021), for all nine classes."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from coopsim.nn.detector.box_code import CODE
from coopsim.nn.detector.encoder import conv
from coopsim.types.taxonomy import CLASS_NAMES

RARE = -math.log((1 - 0.02) / 0.02)
"""Bias of the heat: most cells are no centre."""


class CentreHead(nn.Module):
    """Heat of each class in each cell, and a code of the box (see `box_code`) for selected cells.

    Codes are computed only where a centre is or may be: that is nearly free.
    """

    def __init__(self, channels: int = 64, classes: int = len(CLASS_NAMES)) -> None:
        super().__init__()
        self.channels = channels
        self.shared = conv(channels, channels)
        self.heat_of = nn.Conv2d(channels, classes, 1)
        nn.init.constant_(self.heat_of.bias, RARE)  # type: ignore[arg-type]
        self.code_of = nn.Sequential(nn.Linear(channels, channels), nn.ReLU(), nn.Linear(channels, CODE))

    def heat(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return shared features (B, C, h, w), and logits of the heat (B, 9, h, w), of features (B, C, h, w)."""
        shared = self.shared(features)
        return shared, self.heat_of(shared).float()

    def codes(self, shared_at: Tensor) -> Tensor:
        """Return the codes (N, 19) of N cells from their shared features (N, C), in float32."""
        with torch.autocast(shared_at.device.type, enabled=False):
            code: Tensor = self.code_of(shared_at.float())
        return code


def at_cells(maps: Tensor, cell: Tensor) -> Tensor:
    """Return the features (N, C) of cells (N,), numbered through a batch of maps (B, C, h, w)."""
    batch, channels, rows, columns = maps.shape
    return maps.permute(0, 2, 3, 1).reshape(batch * rows * columns, channels)[cell]
