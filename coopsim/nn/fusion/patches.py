"""Patches: tokens that stand for several cells, for networks that would be too slow with a token a cell."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.fusion.feature_fusion import as_batch, likeness, masked_softmax, start_as_zeros, weighted_sum


class Patches(nn.Module):
    """Cut maps into patches of cells, a token each, and bring what was found for tokens back to the cells.

    With x_j the maps, itself among them, l_j logits of each cell and y_0 the receiver's tokens after a network,

        out = sum_j w_j x_j + A y_0,    w_j = softmax_j(x_0 . x_j / sqrt(C) + l_j)

    over the agents valid in a cell, with A a matrix for each cell of a patch. So no detail has to pass through tokens;
    and as A, and the layers that make logits, start as zeros, the fusion is at first that of `AttFuse`.

    Args:
        features: channels of the maps, C.
        width: channels of a token.
        stride: cells of a patch's edge.
        multiple: rows and columns of tokens divide by this; what maps lack is padded at the end, and masked.
    """

    def __init__(self, features: int, width: int, stride: int, multiple: int = 1) -> None:
        super().__init__()
        self._stride, self._multiple = stride, multiple
        self.cut = nn.Conv2d(features, width, stride, stride)
        self.add = start_as_zeros(nn.Linear(width, features * stride**2))

    def tokens(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Return tokens (L, h, w, width) of all agents, the receiver's first, and which are valid, (L, h, w).

        A token is valid if any of its cells is; masked cells count as zeros in it. Arguments as of
        `FeatureFusion.forward`.
        """
        others = others * mask[:, None].to(others.dtype)
        cut = torch.cat([self.cut(self._padded(each)) for each in (as_batch(own), others)])
        valid = functional.max_pool2d(self._padded(torch.cat([own_mask[None], mask]).to(own.dtype)), self._stride) > 0
        return cut.permute(0, 2, 3, 1).contiguous(), valid

    def weights(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, logits: Tensor) -> Tensor:
        """Return w_j (L, H, W) of each agent in each cell.

        Args:
            own: as of `FeatureFusion.forward`, as are the next three.
            own_mask: see there.
            others: see there.
            mask: see there.
            logits: l_j (L, h, w, stride * stride), of the cells of each token.
        """
        among = self._to_cells(logits, own.shape[-2:])[..., 0]
        return masked_softmax(likeness(own, others) + among, torch.cat([own_mask[None], mask]))

    def pooled(self, weights: Tensor) -> Tensor:
        """Return the means of weights (L, H, W) over patches, (L, h, w), adding to 1 where anyone is valid."""
        pooled = functional.avg_pool2d(self._padded(weights), self._stride)
        return pooled / pooled.sum(0).clamp_min(1e-6)

    def fuse(self, own: Tensor, others: Tensor, mask: Tensor, weights: Tensor, found: Tensor) -> Tensor:
        """Return out (C, H, W) of w_j (L, H, W) and y_0 (h, w, width); the own map where nobody else is valid."""
        added = self._to_cells(self.add(found)[None], own.shape[-2:])[0].permute(2, 0, 1)
        return torch.where(mask.any(0), weighted_sum(own, others, weights) + added, own)

    def _to_cells(self, values: Tensor, size: torch.Size) -> Tensor:
        """Return values (L, *size, C) of cells from those of their tokens, (L, h, w, stride * stride * C)."""
        agents, rows, columns, _ = values.shape
        stride = self._stride
        cells = values.view(agents, rows, columns, stride, stride, -1).transpose(2, 3)
        return cells.reshape(agents, rows * stride, columns * stride, -1)[:, : size[0], : size[1]]

    def _padded(self, maps: Tensor) -> Tensor:
        edge = self._stride * self._multiple
        missing = [-cells % edge for cells in maps.shape[-2:]]
        return functional.pad(maps, (0, missing[1], 0, missing[0])) if any(missing) else maps
