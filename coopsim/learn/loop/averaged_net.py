"""The moving average of a network's weights, which evens out the noise of small batches."""

from __future__ import annotations

import copy

import torch
from torch import nn


class AveragedNet:
    """A copy of a network whose weights follow it slowly: w' <- d w' + (1 - d) w.

    The decay d grows from 0.1 as (1 + step) / (10 + step) up to `decay`, so that early averages are not of random
    weights. Counters and other integers are copied.

    Attributes:
        net: the copy, in evaluation mode.
    """

    def __init__(self, net: nn.Module, decay: float) -> None:
        self.net = copy.deepcopy(net).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def update(self, net: nn.Module, step: int) -> None:
        """Follow the network after a step, from 0."""
        share = 1 - min(self._decay, (1 + step) / (10 + step))
        source = net.state_dict()
        for name, value in self.net.state_dict().items():
            if value.is_floating_point():
                value.lerp_(source[name], share)
            else:
                value.copy_(source[name])
