"""What an object was in its last frames, as a help to say what it is now (CoopTrack's temporal enhancement)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from coopsim.nn.attention.windows import feed_forward
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.instance_attention import AmongInstances, InstanceAttention

_WAVES = 8
_SHORTEST_S, _LONGEST_S = 0.1, 10.0


class InstanceHistory(nn.Module):
    """Attend from each object to its own past, layer by layer, and then among objects.

    The past has the code of its age, so frames need not be equally far apart. Frames that there were not are masked;
    an object without any past stays as it is until the objects attend to each other.

    Args:
        width: channels of an instance.
        layers: number of layers, of both kinds.
        heads: number of heads.
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
        """Return features (K, width).

        Args:
            now: (K, width).
            past: (K, H, width).
            age_s: (K, H); infinite where there was no such frame.
            place_m: (K, 2) where the objects are.
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
