"""Where2comm's fusion (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence
Maps", NeurIPS 2022): attention over agents that knows how sure each of them is.

The other two parts of the method are elsewhere: the choice of the cells that are sent is the codec `sparse_features`,
and what receivers ask for is `coopsim.fusion.request_maps`.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, as_batch, masked_softmax, weighted_sum
from coopsim.support.checks import require_count


@FUSIONS.register("where2comm")
class Where2comm(FeatureFusion):
    """Fuse by attention of several heads, in each cell over the agents valid there, confidences added to the logits.

    With x_0 the receiver's features, x_j and c_j those of agent j and its confidence, head by head

        w_j = softmax_j((Q x_0) . (K x_j) / sqrt(d) + beta c_j),    out = sum_j w_j x_j

    where each head weighs its own share of the channels, and beta >= 0 is learned. The paper's multiplication of the
    weights by c_j is beta log c_j in this place; adding c_j leaves cells alive of which nobody is sure. Its
    feed-forward part is the neck of the cooperative network; its encoding of distances is left out. Without
    confidences in the context all count as 0.

    Args:
        features: number of channels.
        heads: number of heads, which divides it.
        depth: d, length of a head's queries and keys.

    Raises:
        InvalidValueError: the heads do not divide the channels, or a count is not positive.
    """

    def __init__(self, features: int = 64, *, heads: int = 4, depth: int = 8) -> None:
        super().__init__()
        require_count(1, features=features, heads=heads, depth=depth)
        if features % heads:
            raise InvalidValueError(f"heads must divide {features} channels, got {heads}")
        self.heads, self.depth = heads, depth
        self.query = nn.Conv2d(features, heads * depth, 1)
        self.key = nn.Conv2d(features, heads * depth, 1, bias=False)
        self.trust = nn.Parameter(torch.ones(heads))

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        keys = torch.cat([self.key(as_batch(own)), self.key(others)])
        likeness = _split(self.query(as_batch(own)) * keys, 1, self.heads).sum(2) / self.depth**0.5
        logits = likeness.float() + functional.softplus(self.trust)[:, None, None] * _sure(others, context)[:, None]
        weights = masked_softmax(logits, torch.cat([own_mask[None], mask])[:, None])
        fused = weighted_sum(_split(own, 0, self.heads), _split(others, 1, self.heads), weights[:, :, None])
        return fused.flatten(0, 1)


def _split(maps: Tensor, dim: int, heads: int) -> Tensor:
    """Return maps with their dimension of channels split by heads."""
    return maps.view(*maps.shape[:dim], heads, -1, *maps.shape[dim + 1 :])


def _sure(others: Tensor, context: FusionContext) -> Tensor:
    """Return the confidences (1 + S, H, W) of all agents, the receiver's first."""
    sure = torch.zeros((len(others) + 1, *others.shape[-2:]), device=others.device)
    if context.confidence is not None and context.own_confidence is not None:
        sure[0], sure[1:] = context.own_confidence, context.confidence
    return sure
