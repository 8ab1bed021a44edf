"""Encoder of integrated detection and tracking: a fused map, enhanced by the one before (Hu et al., eq. 12-14)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.geometry.se3 import SE3
from coopsim.nn.attention import feed_forward
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.types import BevGrid


class DeformableAttention(nn.Module):
    """Let queries read a map at places that they choose themselves, by torch alone.

    With q a query, p its reference point and x(.) the map between cells, of M heads and K places

        sum_m W_m sum_k A_mk W'_m x(p + S d_mk),   A_m = softmax over k of a linear function of q,

    where the offsets d are linear in q, and S turns and scales them. They begin as rays, a direction for each head.
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
        """Return values (Q, width) that Q queries read. Beyond the map features are zero.

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


_SHORTEST_M, _LONGEST_M = 5.0, 500.0
_POOLED = 4
"""Edge of the cells of a kept map, in cells of the map that attends to it."""


@dataclass(frozen=True, slots=True, eq=False)
class PriorMap:
    """Downsampled map of a frame for the next: tokens (M, D) and their middles (M, 2) m, x and y in the agent's compass
    frame.
    """

    tokens: Tensor
    place_m: Tensor

    @classmethod
    def of(cls, features: Tensor, grid: BevGrid) -> PriorMap:
        """Return the largest features of blocks of cells, of a map (D, h, w)."""
        tokens = functional.max_pool2d(features[None], _POOLED, ceil_mode=True)[0].flatten(1).T
        places = functional.avg_pool2d(
            cell_places(grid, features).T.view(1, 2, *grid.shape), _POOLED, ceil_mode=True, count_include_pad=False
        )
        return cls(tokens, places[0].flatten(1).T)

    def moved(self, dst_SE3_src: SE3) -> PriorMap:
        """Return it in the frame dst of whose frame src it is."""
        turn = self.place_m.new_tensor(dst_SE3_src.rotation[:2, :2].tolist())
        shift = self.place_m.new_tensor(dst_SE3_src.translation[:2].tolist())
        with torch.autocast(turn.device.type, enabled=False):  # places are float32 in a network's pass, too
            return PriorMap(self.tokens, self.place_m @ turn.T + shift)


class PriorEnhancement(nn.Module):
    """Add to the tokens of a map their attention to the map before (Hu, Wang and Wang, eq. 12 and 13).

    With F the tokens of now, F' those before and c(p) a code of places,

        F + MLP(softmax(Q K^T / sqrt(D)) V),   Q = W_q (F + c(p)) + a t, K = W_k (F' + c(p')), V = W_v F',

    t being the time between both. The sum, from which training starts (the MLP's last layer begins as zeros), the code
    and the time are ours: eq. 13 is the MLP alone. 4 divides the width D.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.age = nn.Linear(1, width, bias=False)
        self.then = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU())
        self.out = start_as_zeros(nn.Linear(2 * width, width))
        lengths_m = torch.logspace(math.log10(_SHORTEST_M), math.log10(_LONGEST_M), width // 4)
        self.register_buffer("per_m", 2 * math.pi / lengths_m, persistent=False)

    def forward(self, tokens: Tensor, place_m: Tensor, before: PriorMap, age_s: float) -> Tensor:
        """Return enhanced tokens (N, D) of tokens at places (N, 2); `before`, in the frame of now, is a first frame's
        own map.
        """
        query = self.query(self.norm(tokens) + self._code(place_m)) + self.age(tokens.new_tensor([age_s]))
        known = self.norm(before.tokens)
        key = self.key(known + self._code(before.place_m))
        asked = (each[None, None] for each in (query, key, self.value(known)))  # four dimensions: the quick way
        found = functional.scaled_dot_product_attention(*asked)[0, 0]
        enhanced: Tensor = tokens + self.out(self.then(found))
        return enhanced

    def _code(self, place_m: Tensor) -> Tensor:
        """Return sines and cosines (N, D) of places (N, 2)."""
        phase = (place_m[:, :, None] * self.get_buffer("per_m")).flatten(1)
        return torch.cat([phase.sin(), phase.cos()], dim=1)


def cell_places(grid: BevGrid, like: Tensor) -> Tensor:
    """Return the middles (h w, 2) m of a grid's cells, row by row, as numbers of the kind of `like`."""
    rows, columns = grid.shape
    x = grid.x_m[0] + grid.cell_m * (torch.arange(columns, dtype=like.dtype, device=like.device) + 0.5)
    y = grid.y_m[0] + grid.cell_m * (torch.arange(rows, dtype=like.dtype, device=like.device) + 0.5)
    return torch.stack([x.expand(rows, columns), y[:, None].expand(rows, columns)], dim=-1).flatten(0, 1)


COARSER = 2
"""Cells of the encoder are so many cells of the fused map wide."""


@dataclass(frozen=True, slots=True, eq=False)
class EncodedMap:
    """Map (D, H, W) for the branches, its cells, and the map before it was enhanced, for the next frame."""

    features: Tensor
    grid: BevGrid
    prior: PriorMap


class EncoderLayer(nn.Module):
    """Let each cell attend to a few places around it, followed by a feed-forward layer (eq. 14)."""

    def __init__(self, width: int, heads: int, points: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.attention = DeformableAttention(width, heads, points)
        self.then = feed_forward(width)
        self._points = points

    def forward(self, tokens: Tensor, place_m: Tensor, grid: BevGrid) -> Tensor:
        """Return tokens (h w, D) of the cells of a grid, whose middles are `place_m`."""
        normed = self.norm(tokens)
        axes_m = torch.eye(2, dtype=tokens.dtype, device=tokens.device)[None] * (self._points * grid.cell_m)
        tokens = tokens + self.attention(normed, place_m, axes_m, normed.T.unflatten(1, grid.shape), grid)
        out: Tensor = tokens + self.then(tokens)
        return out


class IntegratedEncoder(nn.Module):
    """Encode a fused map at half its resolution, and add that to the map itself."""

    def __init__(self, features: int, width: int, layers: int, heads: int, points: int) -> None:
        super().__init__()
        self.fine = nn.Conv2d(features, width, 1)
        self.coarser = nn.Conv2d(width, width, 2 * COARSER, COARSER, COARSER // 2, groups=width)
        self.enhance = PriorEnhancement(width)
        self.layers = nn.ModuleList(EncoderLayer(width, heads, points) for _ in range(layers))
        self.added = start_as_zeros(nn.Linear(width, width))

    def forward(self, fused: Tensor, grid: BevGrid, before: PriorMap | None, age_s: float) -> EncodedMap:
        """Encode a fused map (features, H, W), rows and columns even, given the map before in the frame of the grid; a
        first frame's is its own.
        """
        fine, cells = self.fine(fused[None]), grid.coarser(COARSER)
        coarse = self.coarser(fine)[0]
        place_m, prior = cell_places(cells, coarse), PriorMap.of(coarse, cells)
        tokens = self.enhance(coarse.flatten(1).T, place_m, prior if before is None else before, age_s)
        for layer in self.layers:
            tokens = layer(tokens, place_m, cells)
        added = self.added(tokens).T.unflatten(1, cells.shape)[None]
        added = functional.interpolate(added, size=grid.shape, mode="bilinear", align_corners=False)
        return EncodedMap((fine + added)[0], grid, prior)
