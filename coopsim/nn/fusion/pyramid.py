"""Pyramid fusion of HEAL (Lu et al., "An Extensible Framework for Open Heterogeneous Collaborative Perception", ICLR
2024): at several scales, agents weighted by where each believes that objects are.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.detector.detector_net import RARE
from coopsim.nn.fusion.feature_fusion import (
    FUSIONS,
    FeatureFusion,
    Foreground,
    FusionContext,
    as_batch,
    masked_softmax,
    start_as_zeros,
    weighted_sum,
)
from coopsim.support.checks import require_count


@FUSIONS.register("pyramid")
class Pyramid(FeatureFusion):
    """Fuse at strides 1, 2, 4, ... and add what the coarser scales find to the finest.

    At each scale l, a head of one channel f_l gives the belief that an agent's cell shows an object, taught by a loss
    of its own (see `foreground`):

        s_j = sigmoid(f_l(x_j)),    w_j = softmax_j(t_l s_j) over the agents valid there,    y_l = sum_j w_j x_j

    The maps of the next scale are a strided convolution of each agent's maps, depth by depth and then across channels.
    From the coarsest on, y_l is brought to the scale below by a transposed convolution and added.

    In HEAL t_l is 1, so that three agents who see nothing there outweigh one who is sure; here it is learned and starts
    at 4. And there one agent alone passes through the pyramid, too; here cells that nobody else reports keep the own
    map, as in all fusions, so that the head of one agent's own network fits it.

    Args:
        features: number of channels, at all scales.
        levels: number of scales.
    """

    def __init__(self, features: int = 64, *, levels: int = 3) -> None:
        super().__init__(features)
        require_count(1, 8, levels=levels)
        self.believe = nn.ModuleList(nn.Conv2d(features, 1, 1) for _ in range(levels))
        for head in self.believe:
            nn.init.constant_(head.bias, RARE)  # type: ignore[arg-type]
        self.sharpness = nn.Parameter(torch.full((levels,), 4.0))
        self.down = nn.ModuleList(_down(features) for _ in range(levels - 1))
        self.up = nn.ModuleList(nn.ConvTranspose2d(features, features, 2, 2) for _ in range(levels - 1))
        for layer in self.up[:1]:  # the coarse scales start without effect
            start_as_zeros(layer)

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        levels = self._levels(own, own_mask, others, mask)
        fused = [
            weighted_sum(level.own, level.others, masked_softmax(sharpness * level.logits.sigmoid(), level.mask))
            for level, sharpness in zip(levels, self.sharpness, strict=True)
        ]
        while len(fused) > 1:
            coarse, fine = fused.pop(), fused[-1]
            raised = self.up[len(fused) - 1](as_batch(coarse))[0, :, : fine.shape[1], : fine.shape[2]]
            fused[-1] = torch.relu(fine + raised) if len(fused) > 1 else fine + raised * mask.any(0).to(raised.dtype)
        return fused[0]

    def foreground(
        self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext
    ) -> list[Foreground]:
        """Return the beliefs of all agents at each scale, of ceil(H / stride) x ceil(W / stride) cells."""
        levels = self._levels(own, own_mask, others, mask)
        return [Foreground(level.logits, level.mask, 2**number) for number, level in enumerate(levels)]

    def _levels(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor) -> list[_Level]:
        """Return the maps of each scale. Odd sizes are padded with zeros, at the end."""
        others = others * mask[:, None].to(others.dtype)
        masks = torch.cat([own_mask[None], mask])
        levels = [_Level(own, others, masks, self._logits(0, own, others))]
        for number, down in enumerate(self.down, 1):
            odd = (0, own.shape[-1] % 2, 0, own.shape[-2] % 2)
            own, others = down(functional.pad(as_batch(own), odd))[0], down(functional.pad(others, odd))
            masks = functional.max_pool2d(masks.float(), 2, ceil_mode=True) > 0
            inside = masks.to(own.dtype)
            own, others = own * inside[0], others * inside[1:, None]
            levels.append(_Level(own, others, masks, self._logits(number, own, others)))
        return levels

    def _logits(self, number: int, own: Tensor, others: Tensor) -> Tensor:
        believe = self.believe[number]
        return torch.cat([believe(as_batch(own)), believe(others)])[:, 0].float()


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Maps of one scale: own (C, h, w), others (S, C, h, w), mask (1 + S, h, w), logits (1 + S, h, w)."""

    own: Tensor
    others: Tensor
    mask: Tensor
    logits: Tensor


def _down(features: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(features, features, 3, 2, 1, groups=features), nn.Conv2d(features, features, 1), nn.ReLU()
    )
