"""Lift and splat: a picture's features, spread along their lines of sight and gathered in cells seen from above.

Philion and Fidler, "Lift, Splat, Shoot: Encoding Images from Arbitrary Camera Rigs by Implicitly Unprojecting to 3D",
ECCV 2020, section 3: a pixel with feature c and probabilities alpha of depths d_k has the feature alpha_k c at d_k.
"""

from __future__ import annotations

import torch
from torch import Tensor

from coopsim.nn.camera.picture_batch import CameraViews

EXTRA = 2
"""Numbers of a cell of a canvas besides the features: how much was laid there, and how high."""

_LEAST = 1 / 200
"""Smaller probabilities are left out: most of all, which together are a few hundredths."""

_HALF = 0.3
"""Probability in a cell for which its features count about half."""


class Canvas:
    """Sums of what is laid in the cells of A canvases.

    Args:
        agents: A.
        shape: rows and columns.
        features: C of a picture's cell.
        like: a tensor with the device and numbers of the sums.
    """

    def __init__(self, agents: int, shape: tuple[int, int], features: int, like: Tensor) -> None:
        self._agents, self._shape = agents, shape
        self._sums = like.new_zeros(agents * shape[0] * shape[1], features + EXTRA)

    def lay(self, views: CameraViews, features: Tensor, alpha: Tensor, depths_m: Tensor) -> None:
        """Lay pictures out.

        Args:
            views: M pictures.
            features: (M, C, h, w).
            alpha: (M, K, h, w) probabilities of depths; what they lack to 1 is nowhere.
            depths_m: (K,).
        """
        rows, columns = self._shape
        kept = alpha.detach() > _LEAST
        picture, bin_of, i, j = kept.nonzero(as_tuple=True)
        depth = depths_m[bin_of]
        place = views.start[picture] + depth[:, None] * views.ray.permute(0, 2, 3, 1)[picture, i, j]
        column, row = place[:, 0].floor().long(), place[:, 1].floor().long()
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        picture, bin_of, i, j = picture[inside], bin_of[inside], i[inside], j[inside]
        cell = (views.agent[picture] * rows + row[inside]) * columns + column[inside]
        share = alpha[picture, bin_of, i, j][:, None]
        height = 0.25 * place[inside, 2:].clamp(-4.0, 12.0)
        laid = torch.cat([share * features.permute(0, 2, 3, 1)[picture, i, j], share, share * height], 1)
        self._sums = self._sums.index_add(0, cell, laid)

    def painted(self) -> Tensor:
        """Return the canvases (A, C + 2, H, W): means that are weaker where little was laid, zero where nothing was."""
        sums = self._sums
        features, share, height = sums[:, :-EXTRA], sums[:, -2:-1], sums[:, -1:]
        weak = 1 / (share + _HALF)
        flat = torch.cat([features * weak, torch.log1p(share), height * weak], 1)
        return flat.view(self._agents, *self._shape, -1).permute(0, 3, 1, 2)
