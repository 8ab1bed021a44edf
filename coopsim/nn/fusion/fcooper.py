"""F-Cooper: the largest value of each channel (Chen et al., "F-Cooper: Feature based Cooperative Perception for
Autonomous Vehicle Edge Computing System Using 3D Point Clouds", SEC 2019).
"""

from __future__ import annotations

import torch
from torch import Tensor

from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext


@FUSIONS.register("fcooper")
class FCooper(FeatureFusion):
    """Fuse by out = max over agents of their features, cell by cell and channel by channel.

    Features are non-negative, so cells that an agent does not report take part as zeros. No parameters. A sender with a
    wrong pose adds a second object and takes nothing away, which no later layer can tell from two.

    Args:
        features: number of channels; any.
    """

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        for values, valid in zip(others, mask.to(others.dtype), strict=True):
            own = torch.maximum(own, values * valid)
        return own
