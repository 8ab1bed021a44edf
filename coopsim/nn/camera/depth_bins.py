"""Depths as a choice among bins, which a network predicts better than a number, and can leave undecided.

Bins grow linearly with depth (Reading et al., "Categorical Depth Distribution Network for Monocular 3D Object
Detection", CVPR 2021, section 3.1): the middle of bin k of K is near + (far - near) k (k + 1) / (K (K - 1)).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_count, require_positive


@dataclass(frozen=True, slots=True)
class DepthBins:
    """K bins of depth, and one more for all that lies beyond them.

    Attributes:
        nearest_m: middle of the first bin.
        farthest_m: middle of the last one.
        count: K.
    """

    nearest_m: float = 2.0
    farthest_m: float = 60.0
    count: int = 64

    def __post_init__(self) -> None:
        require_positive(nearest_m=self.nearest_m, farthest_m=self.farthest_m)
        require_count(2, 512, depth_bins=self.count)
        if self.nearest_m >= self.farthest_m:
            raise InvalidValueError(
                f"nearest_m must be less than farthest_m, got {self.nearest_m!r} and {self.farthest_m!r}"
            )

    def middles(self) -> Tensor:
        """Return the bins' middles, (K,) m."""
        k = torch.arange(self.count, dtype=torch.float32)
        return self.nearest_m + (self.farthest_m - self.nearest_m) * k * (k + 1) / (self.count * (self.count - 1))

    def shares(self, depth_m: Tensor) -> Tensor:
        """Return depths (M, ...) as shares of bins (M, K + 1, ...): of the two bins beside a depth, by nearness.

        A depth before the first bin counts as in it. What is farther than the last one, or 0 for nothing, is beyond.
        """
        middles = self.middles().to(depth_m.device)
        beyond = (depth_m <= 0) | (depth_m > self.farthest_m)
        inside = depth_m.clamp(self.nearest_m, self.farthest_m)
        above = torch.searchsorted(middles, inside.contiguous()).clamp(1, self.count - 1)
        low, high = middles[above - 1], middles[above]
        share = ((inside - low) / (high - low)).clamp(0, 1)
        share, lower = share.masked_fill(beyond, 1.0), (above - 1).masked_fill(beyond, 0)
        upper = above.masked_fill(beyond, self.count)
        out = depth_m.new_zeros((depth_m.shape[0], self.count + 1, *depth_m.shape[1:]))
        out.scatter_(1, lower[:, None], (1 - share)[:, None])
        return out.scatter_add_(1, upper[:, None], share[:, None])
