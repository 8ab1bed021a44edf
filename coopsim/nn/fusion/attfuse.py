"""AttFuse: attention over agents, cell by cell (Xu et al., "OPV2V: An Open Benchmark Dataset and Fusion Pipeline for
Perception with Vehicle-to-Vehicle Communication", ICRA 2022).
"""

from __future__ import annotations

from torch import Tensor

from coopsim.nn.fusion.feature_fusion import (
    FUSIONS,
    FeatureFusion,
    FusionContext,
    likeness,
    weighted_sum,
)


@FUSIONS.register("attfuse")
class AttFuse(FeatureFusion):
    """Fuse by scaled dot-product attention of the receiver over all agents, itself among them.

    In each cell, with x_0 the receiver's features and x_j those of agent j,

        out = sum_j softmax_j(x_0 . x_j / sqrt(C)) x_j

    over the agents valid there. Others' implementations let zeros of invalid cells take part with logit 0, which
    dilutes what the receiver alone sees; here they have no weight. No parameters.

    Args:
        features: number of channels; any.
    """

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        weights = self.weights(likeness(own, others), own_mask, mask, context)
        return weighted_sum(own, others, weights)
