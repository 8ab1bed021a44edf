"""Expansion: features of a receiver's own kind out of what a sender compressed, given their delay."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

_SCALES_S = (0.1, 0.3, 1.0)


class Expand(nn.Module):
    """Make features of compressed ones: a 3x3 convolution of each channel, then in each cell two layers with ReLU.

    What is late may be spread over its surroundings, weakened or dropped: the kernel of the convolution, the bias of
    the hidden layer and the gain of each feature are base + D s, where s = 1 - exp(-delay / (0.1, 0.3, 1 s)) is 0 for a
    message without delay and at most 1 for any, and D starts as zeros.

    Args:
        channels: compressed, C.
        features: expanded.
        hidden: width of the hidden layer, thanks to which eight channels lose a head about what sixteen would without.
    """

    def __init__(self, channels: int, features: int, hidden: int = 32) -> None:
        super().__init__()
        self.spread = nn.Parameter(torch.zeros(channels, 1, 3, 3))
        self.hidden = nn.Linear(channels, hidden)
        self.mix = nn.Linear(hidden, features)
        self.delayed = nn.Linear(len(_SCALES_S), channels * 9 + hidden + features, bias=False)
        self.register_buffer("scales_s", torch.tensor(_SCALES_S), persistent=False)
        nn.init.zeros_(self.delayed.weight)
        with torch.no_grad():
            self.spread[:, :, 1, 1] = 1.0

    def forward(self, received: Tensor, delay_s: Tensor) -> Tensor:
        """Expand (S, C, H, W), S >= 1, of delays (S,) to (S, features, H, W) >= 0."""
        channels, hidden, features = self.hidden.in_features, self.hidden.out_features, self.mix.out_features
        scales_s = self.get_buffer("scales_s")
        late = 1 - torch.exp(-delay_s.to(scales_s).clamp_min(0)[:, None] / scales_s)
        kernel, bias, gain = self.delayed(late).float()[:, None].split([channels * 9, hidden, features], 2)
        cells = self._spread(received, kernel)
        size = cells.shape[:3]
        within = torch.matmul(cells.flatten(1, 2), self.hidden.weight.T)
        within = within.add_((self.hidden.bias + bias).to(within.dtype)).relu_()
        expanded = torch.bmm(within, self.mix.weight.T * (1 + gain))
        expanded = expanded.add_((self.mix.bias * (1 + gain)).to(expanded.dtype)).relu_()
        return expanded.view(*size, features).permute(0, 3, 1, 2)

    def _spread(self, received: Tensor, kernel: Tensor) -> Tensor:
        """Return the maps (S, H, W, C) after the first convolution, with a kernel (S, 1, 9 C) added for each sender."""
        kernels = (self.spread.flatten() + kernel).view(-1, *self.spread.shape)
        # Slices of a batch, as single maps would not be recognised as channels last, and copied.
        spread = [
            functional.conv2d(received[sender : sender + 1], each, padding=1, groups=len(each))
            for sender, each in enumerate(kernels)
        ]
        return torch.cat(spread).permute(0, 2, 3, 1)
