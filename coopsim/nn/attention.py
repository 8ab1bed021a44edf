"""Attention in windows, codes of delays, and weights of pairs of agents: parts that fusions share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

MASKED = -1e30
"""Added to the logits of tokens that take no part: their weights are zero, and if all are such, equal and not NaN. With
some other large numbers exponentials take three times as long."""


class WindowAttention(nn.Module):
    """Multi-head attention among the tokens of a window, with a bias for each of their offsets (Liu et al., "Swin
    Transformer", ICCV 2021, eq. 4).

    Args:
        width: channels of a token.
        heads: number of heads; divides `width`.
        window: tokens of a window's edge; divides rows and columns.
        spread: the tokens of a window are not neighbours, but a grid over the whole map (Tu et al., "MaxViT", ECCV
            2022).
        together: windows hold the tokens of all agents, and biases differ between tokens of one agent and of two; else
            each agent's are its own.
    """

    def __init__(self, width: int, heads: int, window: int, *, spread: bool = False, together: bool = False) -> None:
        super().__init__()
        self._heads, self._window, self._spread, self._together = heads, window, spread, together
        self.mix = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.bias = nn.Parameter(torch.zeros(2 if together else 1, heads, (2 * window - 1) ** 2))
        self.register_buffer("offset", _offsets(window), persistent=False)

    def forward(self, tokens: Tensor, valid: Tensor) -> Tensor:
        """Return (L, h, w, width) of tokens (L, h, w, width) of L agents; attended to are the `valid` ones."""
        agents = len(tokens)
        grouped = self._grouped(tokens)
        windows = grouped.view(-1, (agents if self._together else 1) * self._window**2, tokens.shape[-1])
        seen = self._grouped(valid[..., None]).view(len(windows), -1)
        found: Tensor = self.out(self._attend(windows, seen, agents)).view(grouped.shape)
        back = (2, 3, 0, 4, 1, 5) if self._spread else (2, 0, 3, 1, 4, 5)
        return found.permute(back).reshape(tokens.shape)

    def _grouped(self, values: Tensor) -> Tensor:
        """Return values (L, h, w, C) as (windows along y, along x, L, window, window, C)."""
        agents, rows, columns, width = values.shape
        size = self._window
        if self._spread:
            split = values.view(agents, size, rows // size, size, columns // size, width).permute(2, 4, 0, 1, 3, 5)
        else:
            split = values.view(agents, rows // size, size, columns // size, size, width).permute(1, 3, 0, 2, 4, 5)
        return split.contiguous()

    def _attend(self, windows: Tensor, seen: Tensor, agents: int) -> Tensor:
        """Return what each of the tokens (G, T, width) of G windows finds among those of its window that are seen."""
        depth = windows.shape[-1] // self._heads
        hidden = (~seen)[:, None].to(windows.dtype) * MASKED
        found = []
        # A head at a time, and not scaled_dot_product_attention: on processors that is quicker in windows this small.
        for query, key, value, bias in zip(*self._by_head(self.mix(windows)), self._bias(agents), strict=True):
            logits = torch.bmm(query * depth**-0.5, key.transpose(1, 2))
            logits = logits.add_(bias.to(logits.dtype)).add_(hidden.to(logits.dtype))
            found.append(torch.bmm(logits.softmax(-1), value))
        return torch.cat(found, -1)

    def _by_head(self, mixed: Tensor) -> list[tuple[Tensor, ...]]:
        """Return queries, keys and values (G, T, d) of each head."""
        return [part.chunk(self._heads, -1) for part in mixed.chunk(3, -1)]

    def _bias(self, agents: int) -> Tensor:
        """Return the biases (heads, T, T) of windows with the tokens of so many agents."""
        by_offset = self.bias[:, :, self.get_buffer("offset")]
        if agents == 1 or not self._together:
            return by_offset[0]
        size = self._window**2
        same = torch.eye(agents, dtype=torch.bool, device=by_offset.device)[None, :, None, :, None]
        both = torch.where(same, by_offset[0][:, None, :, None], by_offset[-1][:, None, :, None])
        return both.reshape(self._heads, agents * size, agents * size)


def _offsets(window: int) -> Tensor:
    """Return the number of the offset between each two tokens of a window, (T, T)."""
    row, column = torch.arange(window**2) // window, torch.arange(window**2) % window
    down, right = (each[:, None] - each + window - 1 for each in (row, column))
    return down * (2 * window - 1) + right


def feed_forward(width: int) -> nn.Sequential:
    """Return the two layers that a transformer applies to each token, with the normalisation before them."""
    return nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.GELU(), nn.Linear(width, width))


def normed_layers(*widths: int) -> list[nn.Module]:
    """Return linear layers between these widths, each followed by a layer normalisation and a ReLU."""
    return [layer for a, b in pairwise(widths) for layer in (nn.Linear(a, b), nn.LayerNorm(b), nn.ReLU())]


_SHORTEST_S, _LONGEST_S, _WAVES = 0.2, 10.0, 8


class DelayCode(nn.Module):
    """Add to an agent's tokens a linear function of sines and cosines of its message's delay.

    V2X-ViT's delay-aware positional encoding (section 3.2.1), of a real number of seconds: eight waves, from 0.2 to 10
    s long. A message without delay, such as the receiver's own map, gets nothing added: of cosines, 1 is subtracted.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        lengths_s = torch.logspace(math.log10(_SHORTEST_S), math.log10(_LONGEST_S), _WAVES)
        self.register_buffer("per_s", 2 * math.pi / lengths_s, persistent=False)
        self.code = nn.Linear(2 * _WAVES, width, bias=False)

    def forward(self, tokens: Tensor, delay_s: Tensor) -> Tensor:
        """Return tokens (1 + S, h, w, width) with the codes of S delays, row 0 being the receiver's."""
        per_s = self.get_buffer("per_s")
        phase = delay_s.to(per_s).clamp(0, _LONGEST_S)[:, None] * per_s
        code = self.code(torch.cat([phase.sin(), phase.cos() - 1], 1)).to(tokens.dtype)
        return torch.cat([tokens[:1], tokens[1:] + code[:, None, None]])


class PairWeights(nn.Module):
    """Compute logits MLP([x_j ; x_0]) of every agent j, itself among them; the same network for all pairs.

    The first layer's product with x_0 is computed once for all agents.
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
