"""The weights of a learned ranking: a linear utility that begins as the rule "need"."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

NEED = (1.0, 1.0, -2.3026, *2 * (1.0986, 1.0986, 0.0, 0.0))
"""Weights with which a ranking is "need": factors 0.1 and 3 in logarithms, see `coopsim.comms.uplinks.budget`."""


@dataclass(frozen=True, slots=True)
class RankingConfig:
    """Options of the network: it has none."""


class RankingNet(nn.Module):
    """Logarithm of an object's utility, linear in the numbers that `coopsim.comms.uplinks.learned_selection` names."""

    def __init__(self, config: RankingConfig) -> None:
        super().__init__()
        self.config = config
        self.weight = nn.Parameter(torch.tensor(NEED))

    def forward(self, rows: Tensor) -> Tensor:
        """Return the utilities (...,) of rows (..., 11)."""
        return rows @ self.weight
