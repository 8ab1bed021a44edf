"""The network of learned rankings: from an object and a receiver to what the receiver gains by hearing of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count

RANKING_FEATURES = 10
"""Numbers of an object and a receiver, see `coopsim.comms.uplinks.learned_selection`."""


@dataclass(frozen=True, slots=True)
class RankingConfig:
    """Sizes of the network.

    Attributes:
        width: width of both hidden layers.
    """

    width: int = 32

    def __post_init__(self) -> None:
        require_count(1, 256, width=self.width)


class RankingNet(nn.Module):
    """Expected gain of a receiver by hearing of an object: 1 finds a missed object, -1 adds a false one.

    `keep` is added to an object of the sender's last message, because trackers need repeated detections.
    """

    def __init__(self, config: RankingConfig) -> None:
        super().__init__()
        self.config = config
        self.gain = nn.Sequential(
            nn.Linear(RANKING_FEATURES, config.width),
            nn.Tanh(),
            nn.Linear(config.width, config.width),
            nn.Tanh(),
            nn.Linear(config.width, 1),
        )
        self.keep = nn.Parameter(torch.zeros(1), requires_grad=False)

    def forward(self, rows: Tensor) -> Tensor:
        """Return the gains (...,) of rows (..., RANKING_FEATURES)."""
        gains: Tensor = self.gain(rows)[..., 0]
        return gains

    def gains(self, rows: Floats) -> Floats:
        """Return the gains (R, N) of rows (R, N, RANKING_FEATURES)."""
        with torch.inference_mode():
            gains: Floats = self(torch.from_numpy(rows.astype(np.float32))).numpy().astype(np.float64)
        return gains
