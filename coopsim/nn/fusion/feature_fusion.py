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
from torch.nn import functional

from coopsim.errors import UnknownNameError
from coopsim.support.checks import require_count
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at

L = TypeVar("L", bound=nn.Module)


@dataclass(frozen=True, slots=True, eq=False)
class FusionContext:
    """Facts about S senders besides their maps.

    Attributes:
        delay_s: (S,) time since the capture of each map.
        kind: (S,) int: 0 car, 1 roadside unit, 2 drone.
        confidence: (S, H, W) in [0, 1], warped like the maps; None: not known.
        own_confidence: (H, W) in [0, 1] of the receiver's own map; None: not known.
        own_kind: kind of the receiver.
        error_m: (S, H, W) standard deviation of each cell's place, by both agents' stated errors; None: not known.
        range_m: (S, H, W) distance of each cell from its sender; None: not known.
    """

    delay_s: Tensor
    kind: Tensor
    confidence: Tensor | None = None
    own_confidence: Tensor | None = None
    own_kind: int = 0
    error_m: Tensor | None = None
    range_m: Tensor | None = None

    @classmethod
    def plain(cls, senders: int) -> FusionContext:
        """Return the context of cars whose maps are not late, without confidences."""
        return cls(torch.zeros(senders), torch.zeros(senders, dtype=torch.long))

    def sure(self, masks: Tensor) -> Tensor:
        """Return the confidences of all agents in the shape (1 + S, H, W) of their masks, the receiver's first.

        They are zeros where they are not known.
        """
        sure = torch.zeros(masks.shape, device=masks.device)
        if self.confidence is not None and self.own_confidence is not None:
            sure[0], sure[1:] = self.own_confidence, self.confidence
        return sure


@dataclass(frozen=True, slots=True, eq=False)
class Foreground:
    """Foreground logits of a fusion at one scale, for auxiliary supervision (see `FeatureFusion.foreground`).

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

    Attributes:
        surest: () factor on confidences that `weights` adds to the logits of agents; None: nothing is added.

    Args:
        features: number of channels.

    Raises:
        InvalidValueError: it is not positive.
    """

    surest: nn.Parameter | None

    def __init__(self, features: int = 64) -> None:
        require_count(1, features=features)
        super().__init__()
        self.register_parameter("surest", None)

    def choose_surest(self, factor: float) -> None:
        """Let `weights` begin as a choice of the surest agent of each cell, with this factor on confidences."""
        self.surest = nn.Parameter(torch.tensor(float(factor)))

    def weights(self, logits: Tensor, own_mask: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Return weights of agents (1 + S, H, W) that add to 1 over the valid ones, by logits (1 + S, H, W)."""
        masks = torch.cat([own_mask[None], mask])
        if self.surest is not None:
            logits = logits.float() + self.surest * context.sure(masks)
        return masked_softmax(logits, masks)

    def smoothed(self, confidence: Tensor) -> Tensor:
        """Return the confidences (A, h, w) by which cells are chosen and sent; by default as they are."""
        return confidence

    def forward(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse the receiver's own map with S others, S >= 0.

        Args:
            own: (C, H, W), the receiver's own map, zero where it does not reach.
            own_mask: (H, W) bool, where it reaches.
            others: (S, C, H, W), warped and expanded; finite values in masked cells have no effect.
            mask: (S, H, W) bool, the valid cells of `others`.
            context: facts about the senders.

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
    """Return weights (L, H, W) that add to 1 over the agents valid in a cell by `mask` (L, H, W); zeros, no NaN,
    without any.
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


def find_fusion(fusion: str) -> Callable[..., FeatureFusion]:
    """Return the class of a fusion by its registered name, or by its place, `module:Class` or `file.py:Class`.

    Raises:
        UnknownNameError: there is no such fusion.
        InvalidValueError: the place has no class of fusions.
    """
    if isinstance(fusion, str) and ":" in fusion:
        return class_at("fusion", fusion, FeatureFusion)  # type: ignore[type-abstract]
    if fusion not in FUSIONS:
        others = "(or file.py:Class, module:Class, or a name that a package adds by the entry points coopsim.fusions)"
        raise UnknownNameError("fusion", fusion, FUSIONS.names(), others)
    return FUSIONS.get(fusion)


class Patches(nn.Module):
    """Cut maps into patches of cells, a token each, and bring the result for tokens back to the cells.

    With x_j the maps, itself among them, l_j logits of each cell and y_0 the receiver's tokens after a network,

        out = sum_j w_j x_j + A y_0,    w_j = softmax_j(x_0 . x_j / sqrt(C) + l_j)

    over the agents valid in a cell, with A a matrix for each cell of a patch. So no detail has to pass through tokens;
    and as A, and the layers that make logits, start as zeros, the fusion is at first that of `AttFuse`.

    Args:
        features: channels of the maps, C.
        width: channels of a token.
        stride: cells of a patch's edge.
        multiple: divisor of the rows and columns of tokens; maps are padded at the end, and masked there.
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

    def logits(self, own: Tensor, others: Tensor, logits: Tensor) -> Tensor:
        """Return the logits of w_j (L, H, W), with l_j (L, h, w, stride * stride) of the cells of each token."""
        return likeness(own, others) + self._to_cells(logits, own.shape[-2:])[..., 0]

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
