"""Expansion: features of a receiver's own kind out of what a sender compressed, given their delay."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

_SCALES_S = (0.1, 0.3, 1.0)


class Expand(nn.Module):
    """Make features of compressed ones: a 3x3 convolution of each channel, then a linear layer and a ReLU.

    What is late may be spread over its surroundings, weakened or dropped: the kernel of the first convolution, and gain
    and bias of each feature, are base + D s, where s = 1 - exp(-delay / (0.1, 0.3, 1 s)) is 0 for a
    message without delay and at most 1 for any, and D starts as zeros.

    Args:
        channels: compressed, C.
        features: expanded.
    """

    def __init__(self, channels: int, features: int) -> None:
        super().__init__()
        self.spread = nn.Parameter(torch.zeros(channels, 1, 3, 3))
        self.mix = nn.Linear(channels, features)
        self.delayed = nn.Linear(len(_SCALES_S), channels * 9 + 2 * features, bias=False)
        self.register_buffer("scales_s", torch.tensor(_SCALES_S), persistent=False)
        nn.init.zeros_(self.delayed.weight)
        with torch.no_grad():
            self.spread[:, :, 1, 1] = 1.0

    def forward(self, received: Tensor, delay_s: Tensor) -> Tensor:
        """Expand (S, C, H, W), S >= 1, of delays (S,) to (S, features, H, W) >= 0."""
        channels, features = self.mix.in_features, self.mix.out_features
        scales_s = self.get_buffer("scales_s")
        late = 1 - torch.exp(-delay_s.to(scales_s).clamp_min(0)[:, None] / scales_s)
        kernel, gain, bias = self.delayed(late).float().split([channels * 9, features, features], 1)
        kernels = (self.spread.flatten(1) + kernel.unflatten(1, (channels, 9))).view(-1, channels, 1, 3, 3)
        # Slices of a batch, as single maps would not be recognised as channels last, and copied.
        spread = [
            functional.conv2d(received[sender : sender + 1], each, padding=1, groups=channels)
            for sender, each in enumerate(kernels)
        ]
        cells = torch.cat(spread).permute(0, 2, 3, 1)
        mixed = torch.bmm(cells.flatten(1, 2), self.mix.weight.T * (1 + gain)[:, None])
        expanded: Tensor = mixed.add_((self.mix.bias + bias)[:, None].to(mixed.dtype)).relu_()
        return expanded.view(*cells.shape[:3], features).permute(0, 3, 1, 2)
