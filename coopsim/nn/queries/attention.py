"""Attention among instances, to their past, and to the map."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from coopsim.nn.attention import MASKED, feed_forward, normed_layers
from coopsim.nn.fusion.feature_fusion import start_as_zeros

_NEAR_M = 10.0


class InstanceAttention(nn.Module):
    """Let each of K instances attend to M tokens of its own or of all, by several heads. It starts as zeros."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self._heads = heads
        self.query = nn.Linear(width, width)
        self.memory = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        start_as_zeros(self.out)

    def forward(self, query: Tensor, memory: Tensor, valid: Tensor, bias: Tensor | None = None) -> Tensor:
        """Return (K, width); zeros in, where no token is valid.

        Args:
            query: (K, width).
            memory: (K, M, width), or (1, M, width) for tokens of all.
            valid: (K, M) or (1, M) bool, the tokens that are attended to.
            bias: (heads, K, M), added to the logits.
        """
        keys, values = self.memory(memory).chunk(2, -1)
        depth = query.shape[-1] // self._heads
        asked = self.query(query).view(len(query), self._heads, depth)
        keys, values = (each.view(*each.shape[:2], self._heads, depth) for each in (keys, values))
        keys, values = (each[0] if len(each) == 1 else each for each in (keys, values))
        tokens = "mhd" if keys.ndim == 3 else "kmhd"
        logits = torch.einsum(f"khd,{tokens}->kmh", asked, keys) / depth**0.5
        if bias is not None:
            logits = logits + bias.permute(1, 2, 0)
        weights = (logits + (~valid)[..., None] * MASKED).softmax(1) * valid[..., None]
        found: Tensor = self.out(torch.einsum(f"kmh,{tokens}->khd", weights, values).flatten(1))
        return found


class AmongInstances(nn.Module):
    """Let instances attend to each other, the nearer the more, followed by a feed-forward layer."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.attention = InstanceAttention(width, heads)
        self.distance = nn.Parameter(torch.linspace(0.0, 2.0, heads))
        self.then = feed_forward(width)
        start_as_zeros(self.then[-1])

    def forward(self, tokens: Tensor, place_m: Tensor) -> Tensor:
        """Return (K, width) of tokens (K, width) at places (K, 2) m."""
        normed = self.norm(tokens)
        away = torch.cdist(place_m, place_m) / _NEAR_M
        everyone = torch.ones(1, len(tokens), dtype=torch.bool, device=tokens.device)
        bias = -nn.functional.softplus(self.distance)[:, None, None] * away
        tokens = tokens + self.attention(normed, normed[None], everyone, bias)
        out: Tensor = tokens + self.then(tokens)
        return out


def mlp(*widths: int) -> nn.Sequential:
    """Return linear layers, each but the last followed by a layer normalisation and a ReLU."""
    return nn.Sequential(*normed_layers(*widths[:-1]), nn.Linear(widths[-2], widths[-1]))


_WAVES = 8
_SHORTEST_S, _LONGEST_S = 0.1, 10.0


class InstanceHistory(nn.Module):
    """Attend from each object to its own past, layer by layer, and then among objects (CoopTrack's temporal
    enhancement).

    The past has the code of its age, so frames need not be equally far apart. Missing frames are masked; an object
    without any past stays as it is until the objects attend to each other.
    """

    def __init__(self, width: int, layers: int, heads: int) -> None:
        super().__init__()
        lengths_s = torch.logspace(torch.tensor(_SHORTEST_S).log10(), torch.tensor(_LONGEST_S).log10(), _WAVES)
        self.register_buffer("per_s", 2 * torch.pi / lengths_s, persistent=False)
        self.age = nn.Sequential(nn.Linear(2 * _WAVES, width), nn.ReLU(), nn.Linear(width, width))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers))
        self.before = nn.ModuleList(InstanceAttention(width, heads) for _ in range(layers))
        self.then = nn.ModuleList(feed_forward(width) for _ in range(layers))
        self.among = nn.ModuleList(AmongInstances(width, heads) for _ in range(layers))
        for each in self.then:
            assert isinstance(each, nn.Sequential)
            start_as_zeros(each[-1])

    def forward(self, now: Tensor, past: Tensor, age_s: Tensor, place_m: Tensor) -> Tensor:
        """Return features (K, width) of `now` (K, width) at places (K, 2), given a past (K, H, width) of ages (K, H),
        infinite where there was no such frame.
        """
        valid = torch.isfinite(age_s)
        some = valid.any(1, keepdim=True)
        phase = torch.where(valid, age_s, 0.0)[..., None] * self.get_buffer("per_s")
        memory = past + self.age(torch.cat([phase.sin(), phase.cos()], dim=-1))
        for norm, before, then in zip(self.norms, self.before, self.then, strict=True):
            enhanced = now + before(norm(now), memory, valid)
            now = torch.where(some, enhanced + then(enhanced), now)
        for among in self.among:
            now = among(now, place_m)
        return now
