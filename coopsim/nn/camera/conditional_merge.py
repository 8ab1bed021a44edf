"""Merging what points and pictures show, by kernels that depend on how sure both of them are.

DINO-CoDT (He et al., 2025, section III-C) merges the voxels of both by "confidence-aware fusion with conditional
convolutions", without an equation. Conditional convolutions are those of Yang et al., "CondConv: Conditionally
Parameterized Convolutions for Efficient Inference", NeurIPS 2019, eq. 1: W = sum_e r_e W_e, with weights
r = sigmoid(R s) for each sample. Here s says how sure the two are; the kernels are 1 x 1.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

CONFIDENCES = 4
"""Length of s: ten times the share of cells with points; mean over pictures of the largest share of a bin of depth;
brightness of pictures; twice the standard deviation of their pixels."""


class ConditionalConv(nn.Module):
    """A 1 x 1 convolution whose kernel is a mixture of E, with weights for each sample.

    Args:
        before: channels in.
        after: channels out.
        experts: E.
    """

    def __init__(self, before: int, after: int, experts: int) -> None:
        super().__init__()
        self.kernels = nn.Parameter(torch.empty(experts, after, before))
        self.biases = nn.Parameter(torch.zeros(experts, after))
        self.route = nn.Linear(CONFIDENCES, experts)
        for kernel in self.kernels.data:
            nn.init.kaiming_uniform_(kernel, a=5**0.5)

    def forward(self, maps: Tensor, confidences: Tensor) -> Tensor:
        """Convolve maps (A, before, H, W) by the kernels of confidences (A, 4). Return (A, after, H, W)."""
        weights = self.route(confidences).sigmoid().to(self.kernels.dtype)
        kernels = torch.einsum("ae,eok->aok", weights, self.kernels)
        biases = weights @ self.biases
        each = [
            functional.conv2d(maps[number : number + 1], kernel[:, :, None, None].to(maps.dtype), bias.to(maps.dtype))
            for number, (kernel, bias) in enumerate(zip(kernels, biases, strict=True))
        ]
        return torch.cat(each)


class ConditionalMerge(nn.Module):
    """Add to a canvas of points what the canvas of pictures says beside it. A fresh one adds nothing.

    Args:
        channels: of each canvas.
        experts: kernels of each convolution.
    """

    def __init__(self, channels: int, experts: int = 4) -> None:
        super().__init__()
        self.first = ConditionalConv(2 * channels, channels, experts)
        self.second = ConditionalConv(channels, channels, experts)
        nn.init.zeros_(self.second.kernels)

    def forward(self, points: Tensor, pictures: Tensor, confidences: Tensor) -> Tensor:
        """Merge canvases (A, C, H, W) of both; where no picture laid anything, that of points stays as it is."""
        hidden = functional.relu(self.first(torch.cat([points, pictures], 1), confidences))
        laid = (pictures != 0).any(1, keepdim=True)
        merged: Tensor = points + self.second(hidden, confidences) * laid
        return merged
