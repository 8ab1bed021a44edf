"""Deformable attention (Zhu et al., "Deformable DETR", ICLR 2021, eq. 2): each query looks at a few places of a map."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.types import BevGrid


class DeformableAttention(nn.Module):
    """Let queries read a map at places that they choose themselves, by torch alone.

    With q a query, p its reference point and x(.) the map between cells, of M heads and K places

        sum_m W_m sum_k A_mk W'_m x(p + S d_mk),   A_m = softmax over k of a linear function of q,

    where the offsets d are linear in q, and S turns and scales them. They begin as rays, a direction for each head.

    Args:
        width: channels of a query, and of the map.
        heads: M; divides `width`.
        points: K.
    """

    def __init__(self, width: int, heads: int, points: int) -> None:
        super().__init__()
        self._heads, self._points = heads, points
        self.offset, self.weight = nn.Linear(width, heads * points * 2), nn.Linear(width, heads * points)
        self.value = nn.Linear(width, width, bias=False)
        self.out = nn.Linear(width, width)
        for each in (self.offset.weight, self.weight.weight, self.weight.bias):
            nn.init.zeros_(each)
        angle = 2 * math.pi * torch.arange(heads) / heads
        ahead = torch.stack([angle.cos(), angle.sin()], dim=1)[:, None]
        away = (torch.arange(points)[:, None] + 1.0) / points
        with torch.no_grad():
            self.offset.bias.copy_((ahead * away).flatten())

    def forward(self, query: Tensor, place_m: Tensor, axes_m: Tensor, features: Tensor, grid: BevGrid) -> Tensor:
        """Return what Q queries read, (Q, width). Beyond the map features are zero.

        Args:
            query: (Q, width).
            place_m: (Q, 2) reference points x, y in the frame of the grid.
            axes_m: (Q, 2, 2) or (1, 2, 2) S, the columns of which are the axes of offsets.
            features: (width, H, W).
            grid: the cells of the features.
        """
        count, heads, points = len(query), self._heads, self._points
        offset = self.offset(query).view(count, heads, points, 2)
        weight = self.weight(query).view(count, heads, points).softmax(-1)
        along, across = (axes_m[:, None, None, :, k] * offset[..., k, None] for k in (0, 1))
        places = _in_map(place_m[:, None, None] + along + across, grid)
        if count * heads * points < features[0].numel():
            read = self._of_few(features, places, weight)
        else:
            read = self._of_many(features, places, weight)
        found: Tensor = self.out(read)
        return found

    def _of_few(self, features: Tensor, places: Tensor, weight: Tensor) -> Tensor:
        """Read the map before W', which is linear: fewer places than cells go through it."""
        count, heads, points = weight.shape
        read = functional.grid_sample(features[None], places.view(1, count, heads * points, 2), align_corners=False)
        mean = (read.view(len(features), count, heads, points) * weight).sum(-1)
        return torch.einsum("cqh,hdc->qhd", mean, self.value.weight.view(heads, -1, len(features))).flatten(1)

    def _of_many(self, features: Tensor, places: Tensor, weight: Tensor) -> Tensor:
        """Read the map after W': each head reads its own channels alone."""
        heads, size = weight.shape[1], features.shape[1:]
        values = (self.value.weight @ features.flatten(1)).view(heads, -1, *size)
        # (heads, depth, Q, points); of places that lie otherwise in memory it takes four times as long.
        read = functional.grid_sample(values, places.transpose(0, 1).contiguous(), align_corners=False)
        return (read * weight.transpose(0, 1)[:, None]).sum(-1).permute(2, 0, 1).flatten(1)


def _in_map(place_m: Tensor, grid: BevGrid) -> Tensor:
    """Return places (..., 2) m in the coordinates of `grid_sample`, in which the map reaches from -1 to 1."""
    low = place_m.new_tensor([grid.x_m[0], grid.y_m[0]])
    high = place_m.new_tensor([grid.x_m[1], grid.y_m[1]])
    return 2 * (place_m - low) / (high - low) - 1
