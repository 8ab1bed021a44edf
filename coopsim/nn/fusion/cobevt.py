"""CoBEVT's fusion: fused axial attention, over agents and space (Xu et al., "CoBEVT: Cooperative Bird's Eye View
Semantic Segmentation with Sparse Transformers", CoRL 2022).
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from coopsim.nn.attention import WindowAttention, feed_forward
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, Patches, start_as_zeros
from coopsim.support.checks import require_choice


@dataclass(frozen=True, slots=True)
class _Size:
    stride: int
    width: int
    heads: int
    depth: int


_WINDOW = 4
_SIZES = {"small": _Size(2, 64, 2, 2), "reference": _Size(1, 256, 8, 3)}


@FUSIONS.register("cobevt")
class CoBEVT(FeatureFusion):
    """Fuse by blocks of two attentions over the tokens of all agents (FAX, section 3.2), each with a feed-forward part.

    The first is among neighbours, in windows of 4 x 4 tokens of each agent; the second among 4 x 4 tokens of each agent
    that lie a quarter of the map apart, as in the paper. With y_j the tokens of agent j after the last block,

        y_0 = LayerNorm(mean_j y_j)

    over the agents valid there. Cells are fused by `Patches`, with logits that are linear in y_j. The published code
    also averages over rows that pad the number of agents, and has a bias for each pair of places in the list of agents;
    here the mean is over valid agents, and biases only tell an agent's own tokens from another's.

    Args:
        features: number of channels.
        size: "small", with patches of 2 x 2 cells, or "reference", the paper's, a token a cell.

    Raises:
        InvalidValueError: features is not positive.
        UnknownNameError: there is no such size.
    """

    def __init__(self, features: int = 64, *, size: str = "small") -> None:
        super().__init__(features)
        require_choice("size", size, _SIZES)
        chosen = _SIZES[size]
        self.patches = Patches(features, chosen.width, chosen.stride, _WINDOW)
        self.blocks = nn.ModuleList(_Attention(chosen, spread) for _ in range(chosen.depth) for spread in (False, True))
        self.norm = nn.LayerNorm(chosen.width)
        self.weigh = start_as_zeros(nn.Linear(chosen.width, chosen.stride**2))

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        tokens, valid = self.patches.tokens(own, own_mask, others, mask)
        for block in self.blocks:
            tokens = block(tokens, valid)
        present = valid[..., None].to(tokens.dtype)
        mean = (tokens * present).sum(0) / present.sum(0).clamp_min(1)
        logits = self.patches.logits(own, others, self.weigh(tokens))
        weights = self.weights(logits, own_mask, mask, context)
        return self.patches.fuse(own, others, mask, weights, self.norm(mean))


class _Attention(nn.Module):
    """Attention of a block, and the feed-forward part that follows it."""

    def __init__(self, size: _Size, spread: bool) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(size.width)
        self.attention = WindowAttention(size.width, size.heads, _WINDOW, spread=spread, together=True)
        self.forward_part = feed_forward(size.width)

    def forward(self, tokens: Tensor, valid: Tensor) -> Tensor:
        tokens = tokens + self.attention(self.norm(tokens), valid)
        found: Tensor = tokens + self.forward_part(tokens)
        return found
