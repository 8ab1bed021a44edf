"""Fusions: one map of features out of one's own and those received. Derive from `FeatureFusion` to plug in your own.

What every fusion keeps to, and the tests hold all registered ones to:

- One agent alone has its own map, unchanged; so has each cell that nobody else reports.
- Cells that nobody reports are zero, and features are non-negative, as after a ReLU.
- Any number of senders; their order, and senders without valid cells, change nothing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn

from coopsim.support.registry import Registry

L = TypeVar("L", bound=nn.Module)


@dataclass(frozen=True, slots=True, eq=False)
class FusionContext:
    """What is known of S senders beside their maps.

    Attributes:
        delay_s: (S,) time since the capture of each map.
        kind: (S,) int: 0 car, 1 roadside unit, 2 drone.
        confidence: (S, H, W) in [0, 1], warped as the maps; None: not known.
        own_confidence: (H, W) in [0, 1] of the receiver's own map; None: not known.
        own_kind: of the receiver, as `kind`.
    """

    delay_s: Tensor
    kind: Tensor
    confidence: Tensor | None = None
    own_confidence: Tensor | None = None
    own_kind: int = 0

    @classmethod
    def plain(cls, senders: int) -> FusionContext:
        """Return the context of cars whose maps are not late, without confidences."""
        return cls(torch.zeros(senders), torch.zeros(senders, dtype=torch.long))


@dataclass(frozen=True, slots=True, eq=False)
class Foreground:
    """What a fusion believes about where objects are, for a loss that teaches it (see `FeatureFusion.foreground`).

    Attributes:
        logits: (L, h, w), row 0 the own map's.
        valid: (L, h, w) bool.
        stride: width of a cell in cells of the fused map.
    """

    logits: Tensor
    valid: Tensor
    stride: int


class FeatureFusion(nn.Module, ABC):
    """A fusion of feature maps on one grid, cell (row, column) being the same place in all of them. Override `fuse`.

    A constructor takes the number of channels first, and parameters by keyword, which recipes and weights name.
    """

    def forward(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse the receiver's own map with S others, S >= 0.

        Args:
            own: (C, H, W), the receiver's own map, zero where it does not reach.
            own_mask: (H, W) bool, where it reaches.
            others: (S, C, H, W), warped and expanded; what masked cells hold is of no effect, as long as it is finite.
            mask: (S, H, W) bool, the valid cells of `others`.
            context: what else is known of the senders.

        Returns:
            (C, H, W). With no sender `own` itself.
        """
        if not len(others):
            return own
        return self.fuse(own, own_mask, others, mask, context)

    @abstractmethod
    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse with S >= 1 others; arguments and result as of `forward`."""

    def foreground(
        self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext
    ) -> list[Foreground]:
        """Return beliefs to be taught by a loss beside the head's, one a scale; arguments as of `forward`."""
        return []


def as_batch(image: Tensor) -> Tensor:
    """Return a map (C, H, W) as a batch (1, C, H, W). As `image[None]`, but known to be channels last where it is.

    Of `image[None]` convolutions make a copy first.
    """
    return image.permute(1, 2, 0)[None].permute(0, 3, 1, 2)


def masked_softmax(logits: Tensor, mask: Tensor) -> Tensor:
    """Return weights (L, H, W) that add to 1 over the valid agents of a cell. Cells without any have zeros, no NaN.

    Args:
        logits: (L, H, W).
        mask: (L, H, W) bool.
    """
    logits = logits.float().masked_fill(~mask, torch.finfo(torch.float32).min)
    return logits.softmax(0) * mask


def likeness(own: Tensor, others: Tensor) -> Tensor:
    """Return x_0 . x_j / sqrt(C) in each cell, (1 + S, H, W), of an own map x_0 (C, H, W) and others x_j (S, C, H, W).

    Row 0 is that of the own map with itself.
    """
    products = torch.cat([(own * own).sum(0, keepdim=True), (own * others).sum(1)])
    return products / math.sqrt(len(own))


def weighted_sum(own: Tensor, others: Tensor, weights: Tensor) -> Tensor:
    """Return (C, H, W), the sum of maps times weights (1 + S, H, W) or (1 + S, C, H, W), row 0 the own's."""
    weights = weights.to(own.dtype)
    total = own * weights[0]
    for values, weight in zip(others, weights[1:], strict=True):
        total = torch.addcmul(total, values, weight)
    return total


def start_as_zeros(layer: L) -> L:
    """Set a layer's weights to zero, so that a branch beside others starts without effect. Return the layer."""
    for weights in layer.parameters():
        nn.init.zeros_(weights)
    return layer


FUSIONS: Registry[Callable[..., FeatureFusion]] = Registry("fusion", home="coopsim.nn.fusion", group="coopsim.fusions")
"""Classes of fusions by name, called with the number of channels and the fusion's own parameters; packages add theirs
through the entry-point group `coopsim.fusions`."""
