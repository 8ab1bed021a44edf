"""How much each agent counts in a cell, by a small network that compares its features with the receiver's."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from torch import Tensor, nn


class PairWeights(nn.Module):
    """Compute logits MLP([x_j ; x_0]) of every agent j, itself among them; the same network for all pairs.

    What its first layer makes of x_0 is computed once for all agents.

    Args:
        width: channels of the features.
        hidden: widths of the hidden layers, one at least.
        outputs: logits of each pair.
    """

    def __init__(self, width: int, hidden: Sequence[int], outputs: int = 1) -> None:
        super().__init__()
        self.sender = nn.Linear(width, hidden[0], bias=False)
        self.receiver = nn.Linear(width, hidden[0])
        layers: list[nn.Module] = []
        for before, after in pairwise(hidden):
            layers += [nn.ReLU(inplace=True), nn.Linear(before, after)]
        self.rest = nn.Sequential(*layers, nn.ReLU(inplace=True), nn.Linear(hidden[-1], outputs))

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (L, h, w, outputs) of features (L, h, w, width), row 0 the receiver's."""
        found: Tensor = self.rest(self.sender(features) + self.receiver(features[:1]))
        return found
