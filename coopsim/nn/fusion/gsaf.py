"""GSAF, the fusion of DINO-CoDT (He et al., "DINO-CoDT: Multi-class Collaborative Detection and Tracking with Vision
Foundation Models", 2025): windows of several sizes inside each agent's map, then a weight for each agent and cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from coopsim.nn.attention import PairWeights, WindowAttention
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, Patches, start_as_zeros
from coopsim.support.checks import require_choice


@dataclass(frozen=True, slots=True)
class _Size:
    stride: int
    width: int
    heads: tuple[int, ...]
    windows: tuple[int, ...]


_SIZES = {"small": _Size(2, 64, (2, 2), (4, 8)), "reference": _Size(1, 128, (8, 4, 2), (4, 8, 16))}


@FUSIONS.register("gsaf")
class GSAF(FeatureFusion):
    """Fuse by attention inside each agent's map, and then by weights of agents (section III-D, eq. 1 to 4).

    With F_j the tokens of agent j, and Z_pj what attention in windows of the p-th size makes of them (eq. 1),

        F'_j = F_j + W [Z_1j ; ... ; Z_Pj]
        b_j  = softmax_j(MLP([F'_0 ; F'_j]))                             (eq. 3)
        F~   = sum_j b_j F'_j,    y_0 = LayerNorm(F~ + MLP(F~))          (eq. 2, 4)

    Cells are fused as `Patches` has it: b_j is a number for each cell of a patch, to whose logits `AttFuse`'s are
    added, and in eq. 2 its mean over the patch.

    The paper gives no sizes of windows, heads or networks, and does not say how the P C channels of its concatenation
    become C again: here by W. F_j in F'_j, and a LayerNorm before eq. 1, are added. Its last LayerNorm is on what is
    added to the cells, not on the cells, since they must stay what the head of one agent's network knows.

    Args:
        features: number of channels.
        size: "small", with patches of 2 x 2 cells and windows of 4 and 8 tokens, or "reference", with a token a cell
            and windows of 4, 8 and 16.

    Raises:
        InvalidValueError: features is not positive.
        UnknownNameError: there is no such size.
    """

    def __init__(self, features: int = 64, *, size: str = "small") -> None:
        super().__init__(features)
        require_choice("size", size, _SIZES)
        chosen = _SIZES[size]
        width = chosen.width
        self.patches = Patches(features, width, chosen.stride, max(chosen.windows))
        self.norm = nn.LayerNorm(width)
        self.branches = nn.ModuleList(
            WindowAttention(width, heads, window) for heads, window in zip(chosen.heads, chosen.windows, strict=True)
        )
        self.join = nn.Linear(width * len(self.branches), width)
        self.compare = PairWeights(width, (width, 16), chosen.stride**2)
        start_as_zeros(self.compare.rest[-1])
        self.refine = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))
        self.last_norm = nn.LayerNorm(width)

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        tokens, valid = self.patches.tokens(own, own_mask, others, mask)
        normed = self.norm(tokens)
        tokens = tokens + self.join(torch.cat([branch(normed, valid) for branch in self.branches], -1))
        logits = self.patches.logits(own, others, self.compare(tokens))
        weights = self.weights(logits, own_mask, mask, context)
        share = self.patches.pooled(weights)[..., None].to(tokens.dtype)
        fused = (tokens * share).sum(0)
        return self.patches.fuse(own, others, mask, weights, self.last_norm(fused + self.refine(fused)))
