"""A code of how late a message is, for networks that are to correct it."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

_SHORTEST_S, _LONGEST_S, _WAVES = 0.2, 10.0, 8


class DelayCode(nn.Module):
    """Add to an agent's tokens a linear function of sines and cosines of its message's delay.

    V2X-ViT's delay-aware positional encoding (section 3.2.1), of a real number of seconds: eight waves, from 0.2 to
    10 s long. A message without delay, as the receiver's own map, gets nothing added: of cosines, 1 is subtracted.

    Args:
        width: channels of a token.
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
