"""The fusion of FF-Tracking: own and received features, concatenated and convolved (Hu, Wang and Wang, "Integrated
Detection and Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure Cooperation", eq. 11).
"""

from __future__ import annotations

from functools import reduce

import torch
from torch import Tensor, nn

from coopsim.nn.fusion.feature_fusion import FUSIONS, FeatureFusion, FusionContext, as_batch, start_as_zeros


@FUSIONS.register("ff_tracking")
class FFTracking(FeatureFusion):
    """Fuse by concatenation and a convolution, beside a maximum.

    With x_0 the receiver's features and m = max_j x_j over the senders that report a cell,

        out = relu(max(x_0, m) + W [x_0; m] + b)

    in cells that a sender reports, x_0 in the others. Eq. 11 is `Conv(Concat(F_veh, F_align))` for one sender: the
    maximum over senders, and that beside the convolution, from which training starts (W = 0, b = 0), are ours. The
    convolution is 1 x 1, as a cooperative network's neck mixes neighbours.

    Args:
        features: number of channels.
    """

    def __init__(self, features: int = 64) -> None:
        super().__init__(features)
        self.convolve = start_as_zeros(nn.Conv2d(2 * features, features, 1))

    def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Fuse; see `FeatureFusion.forward`."""
        reported = others * mask[:, None].to(others.dtype)
        most = reduce(torch.maximum, reported)  # on CPUs several times as fast as amax in the layout of warped maps
        joined: Tensor = self.convolve(as_batch(torch.cat([own, most.to(own.dtype)])))[0]
        fused = (torch.maximum(own, most) + joined).relu().to(own.dtype)
        return torch.where(mask.any(0), fused, own)
