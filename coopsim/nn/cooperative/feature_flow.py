"""Feature flow: what a sender's map changes by in time, so that a receiver can move a late one to now.

Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure
Cooperation", eq. 6-9, after FFNet (Yu et al., "Flow-Based Feature Fusion for Vehicle-Infrastructure Cooperative 3D
Object Detection", NeurIPS 2023).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.fusion.feature_fusion import start_as_zeros

LONGEST_S = 0.5
"""Maps further apart than this have too little in common for a derivative, with a little room for rounding."""


class FeatureFlow(nn.Module):
    """The derivative in time of what a sender sends, from its map now and the one before.

    Three scales, joined: at cells of 1.2 m the coarsest layers see 60 m, farther than anything moves in a second. The
    last layer starts as zeros: at first nothing moves.

    Args:
        channels: numbers a cell in a message without flow, C.
        width: channels of the finest scale; the others have twice as many.
    """

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        wide = 2 * width
        self.near = nn.Sequential(_conv(2 * channels + 1, width), _conv(width, width))
        self.middle = nn.Sequential(_conv(width, wide, 2), _conv(wide, wide))
        self.far = nn.Sequential(_conv(wide, wide, 2), _conv(wide, wide), _conv(wide, wide))
        self.sides = nn.ModuleList(nn.Conv2d(each, width, 1) for each in (width, wide, wide))
        self.join = _conv(3 * width, width)
        self.last = start_as_zeros(nn.Conv2d(width, channels, 1))

    def forward(self, now: Tensor, before: Tensor, known: Tensor, interval_s: Tensor) -> Tensor:
        """Return derivatives (A, C, h, w), per second.

        Args:
            now: (A, C, h, w), what A senders send.
            before: (A, C, h, w), what they sent before, brought into their frame of now; zeros where not `known`.
            known: (A, h, w) bool, the cells that the map before reaches.
            interval_s: (A,) time between both, > 0.
        """
        scales = [self.near(torch.cat([now, before, known[:, None].to(now.dtype)], 1))]
        for scale in (self.middle, self.far):
            scales.append(scale(scales[-1]))
        sides = [side(each) for side, each in zip(self.sides, scales, strict=True)]
        size = sides[0].shape[-2:]
        sides[1:] = [functional.interpolate(each, size=size, mode="nearest") for each in sides[1:]]
        change: Tensor = self.last(self.join(torch.cat(sides, 1))).float()
        return change / interval_s.view(-1, 1, 1, 1).to(change)


def moved_on(values: Tensor, change: Tensor, delay_s: Tensor) -> Tensor:
    """Return maps as they are after a delay, F + dt F' (eq. 9); without delay the maps themselves, bit for bit.

    Args:
        values: (A, C, h, w), F.
        change: (A, C, h, w), F', per second.
        delay_s: (A,) dt, any real numbers.

    Raises:
        InvalidValueError: shapes differ.
    """
    if values.shape != change.shape or delay_s.shape != values.shape[:1]:
        raise InvalidValueError(
            f"change must have the shape {tuple(values.shape)} of the maps, and delay_s a number for each, got "
            f"{tuple(change.shape)} and {tuple(delay_s.shape)}"
        )
    delay = delay_s.view(-1, 1, 1, 1).to(values)
    return torch.where(delay == 0, values, values + delay * change)


def _conv(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """Return a 3 x 3 convolution with ReLU, normalised over each map by itself.

    Messages change while the network learns them. Without normalisation all units fall below zero on the way, and no
    gradient brings them back.
    """
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1), nn.GroupNorm(1, after), nn.ReLU())
