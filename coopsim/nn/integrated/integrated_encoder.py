"""The encoder of integrated detection and tracking: a fused map, enhanced by the map before (Hu et al., eq. 12-14)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.attention.windows import feed_forward
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.integrated.deformable_attention import DeformableAttention
from coopsim.nn.integrated.prior_enhancement import PriorEnhancement, PriorMap, cell_places
from coopsim.types import BevGrid

COARSER = 2
"""Cells of the encoder are so many cells of the fused map wide."""


@dataclass(frozen=True, slots=True, eq=False)
class EncodedMap:
    """What an encoder makes of a fused map.

    Attributes:
        features: (D, H, W) for the branches.
        grid: their cells, those of the fused map.
        prior: of the map before it was enhanced, for the next frame.
    """

    features: Tensor
    grid: BevGrid
    prior: PriorMap


class EncoderLayer(nn.Module):
    """Let each cell look at a few places around it, and then think for itself (eq. 14).

    Args:
        width: channels of a cell.
        heads: of the attention.
        points: places of a head.
    """

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
    """Encode a fused map at half its resolution, and add that to the map itself.

    Args:
        features: channels of the fused map.
        width: D, channels of the result.
        layers: number of layers.
        heads: of their attention.
        points: places of a head.
    """

    def __init__(self, features: int, width: int, layers: int, heads: int, points: int) -> None:
        super().__init__()
        self.fine = nn.Conv2d(features, width, 1)
        self.coarser = nn.Conv2d(width, width, 2 * COARSER, COARSER, COARSER // 2, groups=width)
        self.enhance = PriorEnhancement(width)
        self.layers = nn.ModuleList(EncoderLayer(width, heads, points) for _ in range(layers))
        self.added = start_as_zeros(nn.Linear(width, width))

    def forward(self, fused: Tensor, grid: BevGrid, before: PriorMap | None, age_s: float) -> EncodedMap:
        """Return the encoded map.

        Args:
            fused: (features, H, W), rows and columns even.
            grid: its cells.
            before: of the frame before, in the frame of the grid; None: there is none, and the map is its own.
            age_s: time since then.
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
