"""Where2comm's fusion (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence
Maps", NeurIPS 2022): attention over agents that takes into account how sure each of them is.

The other two parts of the method are elsewhere: the choice of the cells that are sent is the codec `sparse_features`,
and what receivers ask for is `coopsim.fusion.request_maps`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.nn.fusion.feature_fusion import (
    FUSIONS,
    FeatureFusion,
    FusionContext,
    as_batch,
    weighted_sum,
)
from coopsim.support.checks import require_between, require_count


@FUSIONS.register("where2comm")
class Where2comm(FeatureFusion):
    """Fuse by attention, in each cell over the agents valid there, with their confidences added to the logits.

    With x_0 the receiver's features, x_j and c_j those of agent j and its confidence,

        w_j = softmax_j((Q x_0) . (K x_j) / sqrt(d) + beta c_j),    out = sum_j w_j x_j

    with beta >= 0 learned. The paper's multiplication of the weights by c_j is beta log c_j in this place; adding c_j
    keeps cells alive of which nobody is sure. It has several heads and an encoding of distances, left out here; its
    feed-forward part is the neck of the cooperative network. Without confidences in the context all count as 0.

    Args:
        features: number of channels.
        depth: d, length of queries and keys.
        smooth_cells: standard deviation of the Gaussian that smooths confidences, in cells; the published code has 1,
            over 5 x 5 cells. 0: they are not smoothed.

    Raises:
        InvalidValueError: a count is not positive, or the Gaussian wider than 8 cells.
    """

    def __init__(self, features: int = 64, *, depth: int = 32, smooth_cells: float = 0.0) -> None:
        super().__init__(features)
        require_count(1, 1024, depth=depth)
        require_between(0, 8, smooth_cells=smooth_cells)
        self.depth, self.smooth_cells = depth, smooth_cells
        self.query = nn.Conv2d(features, depth, 1)
        self.key = nn.Conv2d(features, depth, 1, bias=False)
        self.trust = nn.Parameter(torch.ones(()))

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        alone = as_batch(own)
        asked = self.query(alone)
        likeness = torch.cat([(asked * self.key(alone)).sum(1), (asked * self.key(others)).sum(1)])
        logits = likeness.float() / self.depth**0.5
        logits = logits + functional.softplus(self.trust) * context.sure(logits)
        return weighted_sum(own, others, self.weights(logits, own_mask, mask, context))

    def smoothed(self, confidence: Tensor) -> Tensor:
        """Return confidences (A, h, w) after a Gaussian of `smooth_cells` (section 4.2)."""
        if not self.smooth_cells:
            return confidence
        reach = math.ceil(2 * self.smooth_cells)
        away = torch.arange(-reach, reach + 1, device=confidence.device, dtype=confidence.dtype)
        kernel = torch.exp(-0.5 * (away / self.smooth_cells) ** 2)
        kernel = torch.outer(kernel, kernel)[None, None] / kernel.sum() ** 2
        return functional.conv2d(confidence[:, None], kernel, padding=reach)[:, 0]
