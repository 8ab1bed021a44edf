"""DiscoNet: a weight for each agent in each cell (Li et al., "Learning Distilled Collaboration Graph for Multi-Agent
Perception", NeurIPS 2021).

The other half of the method, a teacher that sees the points of all agents, is a loss in training: `teacher: early` in a
recipe, see `coopsim.learn.losses.fused_losses`.
"""

from __future__ import annotations

import torch
from torch import Tensor

from coopsim.nn.attention import PairWeights
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, weighted_sum
from coopsim.support.checks import require_choice

_HIDDEN = {"small": (64, 16), "reference": (128, 32, 8)}
"""Widths of the hidden layers, by size; the reference is the paper's."""


@FUSIONS.register("disconet")
class DiscoNet(FeatureFusion):
    """Fuse by matrices of weights, one entry for each cell, that a small network finds for each pair of agents.

    With x_0 the receiver's features and x_j those of agent j, itself among them, in each cell (section 3.2, step S2)

        w_j = softmax_j(MLP([x_j ; x_0])),    out = sum_j w_j x_j

    over the agents valid there. The published code has a ReLU before the softmax, so that an agent can count more than
    the others, but hardly less; and batch normalisations, whose statistics one frame cannot give. Both are left out.

    Args:
        features: number of channels.
        size: "small" or "reference".

    Raises:
        InvalidValueError: features is not positive.
        UnknownNameError: there is no such size.
    """

    def __init__(self, features: int = 64, *, size: str = "small") -> None:
        super().__init__(features)
        require_choice("size", size, _HIDDEN)
        self.compare = PairWeights(features, _HIDDEN[size])

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        cells = torch.cat([own.permute(1, 2, 0)[None], others.permute(0, 2, 3, 1)])
        logits = self.compare(cells)[..., 0]
        return weighted_sum(own, others, self.weights(logits, own_mask, mask, context))
