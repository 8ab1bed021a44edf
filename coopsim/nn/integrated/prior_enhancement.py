"""Temporal prior enhancement: a map attends to that of the frame before (Hu, Wang and Wang, eq. 12 and 13)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.geometry.se3 import SE3
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.types import BevGrid

_SHORTEST_M, _LONGEST_M = 5.0, 500.0
_POOLED = 4
"""Edge of the cells of a kept map, in cells of the map that attends to it."""


@dataclass(frozen=True, slots=True, eq=False)
class PriorMap:
    """The map of a frame, downsampled, as the next frame attends to it.

    Attributes:
        tokens: (M, D).
        place_m: (M, 2) x, y of their middles, in the agent's compass frame.
    """

    tokens: Tensor
    place_m: Tensor

    @classmethod
    def of(cls, features: Tensor, grid: BevGrid) -> PriorMap:
        """Return the largest features of blocks of cells, of a map (D, h, w)."""
        tokens = functional.max_pool2d(features[None], _POOLED, ceil_mode=True)[0].flatten(1).T
        places = functional.avg_pool2d(
            cell_places(grid, features).T.view(1, 2, *grid.shape), _POOLED, ceil_mode=True, count_include_pad=False
        )
        return cls(tokens, places[0].flatten(1).T)

    def moved(self, dst_SE3_src: SE3) -> PriorMap:
        """Return it in the frame dst of whose frame src it is."""
        turn = self.place_m.new_tensor(dst_SE3_src.rotation[:2, :2].tolist())
        shift = self.place_m.new_tensor(dst_SE3_src.translation[:2].tolist())
        with torch.autocast(turn.device.type, enabled=False):  # places are float32 in a network's pass, too
            return PriorMap(self.tokens, self.place_m @ turn.T + shift)


class PriorEnhancement(nn.Module):
    """Add to the tokens of a map what they find in the map before.

    With F the tokens of now, F' those before and c(p) a code of places,

        F + MLP(softmax(Q K^T / sqrt(D)) V),   Q = W_q (F + c(p)) + a t, K = W_k (F' + c(p')), V = W_v F',

    t being the time between both. The sum, from which training starts (the MLP's last layer begins as zeros), the code
    and the time are ours: eq. 13 is the MLP alone.

    Args:
        width: D, channels of a token; 4 divides it.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.age = nn.Linear(1, width, bias=False)
        self.then = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU())
        self.out = start_as_zeros(nn.Linear(2 * width, width))
        lengths_m = torch.logspace(math.log10(_SHORTEST_M), math.log10(_LONGEST_M), width // 4)
        self.register_buffer("per_m", 2 * math.pi / lengths_m, persistent=False)

    def forward(self, tokens: Tensor, place_m: Tensor, before: PriorMap, age_s: float) -> Tensor:
        """Return enhanced tokens (N, D).

        Args:
            tokens: (N, D) of the map of now.
            place_m: (N, 2) of their middles.
            before: the map before, in the frame of now; of a first frame, its own map.
            age_s: time since then.
        """
        query = self.query(self.norm(tokens) + self._code(place_m)) + self.age(tokens.new_tensor([age_s]))
        known = self.norm(before.tokens)
        key = self.key(known + self._code(before.place_m))
        asked = (each[None, None] for each in (query, key, self.value(known)))  # four dimensions: the quick way
        found = functional.scaled_dot_product_attention(*asked)[0, 0]
        enhanced: Tensor = tokens + self.out(self.then(found))
        return enhanced

    def _code(self, place_m: Tensor) -> Tensor:
        """Return sines and cosines (N, D) of places (N, 2)."""
        phase = (place_m[:, :, None] * self.get_buffer("per_m")).flatten(1)
        return torch.cat([phase.sin(), phase.cos()], dim=1)


def cell_places(grid: BevGrid, like: Tensor) -> Tensor:
    """Return the middles (h w, 2) m of a grid's cells, row by row, as numbers of the kind of `like`."""
    rows, columns = grid.shape
    x = grid.x_m[0] + grid.cell_m * (torch.arange(columns, dtype=like.dtype, device=like.device) + 0.5)
    y = grid.y_m[0] + grid.cell_m * (torch.arange(rows, dtype=like.dtype, device=like.device) + 0.5)
    return torch.stack([x.expand(rows, columns), y[:, None].expand(rows, columns)], dim=-1).flatten(0, 1)
