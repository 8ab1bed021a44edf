"""LGPEnc, the local-global encoder of an object's points: seven layers and two learned vectors.

Gu et al., "YOLOO: You Only Learn from Others Once", section III-C2 and eq. 1 to 3.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.identity.object_points import LEAST_POINTS, NUMBERS, PointBatch
from coopsim.support.checks import require_choice, require_count, require_flag

_SIZES = {
    "small": ((32, 32, 48, 64, 128), 64, 128),
    "paper": ((64, 64, 64, 128, 1024), 512, 400),
}
"""Of each size: the widths of the first five layers, the length of the vector, and the most points of an object. Of the
source's, those of the first, third and fourth layer are not given; they are PointNet's here."""


@dataclass(frozen=True, slots=True)
class PointIdentityConfig:
    """Sizes of the network.

    Attributes:
        size: "small", or "paper" with the source's widths.
        widths: of the first five layers; None: those of the size.
        dim: length of the vector; None: that of the size.
        points: most points of an object that are looked at; None: those of the size.
        box: also give the network the box's length, width and height; not in the source.
    """

    size: str = "small"
    widths: tuple[int, ...] | None = None
    dim: int | None = None
    points: int | None = None
    box: bool = True

    def __post_init__(self) -> None:
        require_choice("size", self.size, _SIZES)
        for name, usual in zip(("widths", "dim", "points"), _SIZES[self.size], strict=True):
            if getattr(self, name) is None:
                object.__setattr__(self, name, usual)
        if not isinstance(self.widths, (tuple, list)) or len(self.widths) != 5:
            raise InvalidValueError(f"widths must be 5 numbers, got {self.widths!r}")
        for k, width in enumerate(self.widths):
            require_count(1, 4096, **{f"widths[{k}]": width})
        require_count(1, 4096, dim=self.dim)
        require_count(LEAST_POINTS, 4096, points=self.points)
        require_flag(box=self.box)
        object.__setattr__(self, "widths", tuple(self.widths))


class PointIdentityNet(nn.Module):
    """From the points of objects to unit vectors that tell them apart.

    The features of a point are those of the second and of the fifth layer. Their largest values over an object's points
    are its global part (eq. 1). Its local part is their mean, weighted by what the sixth layer makes of the second's
    features (eq. 2). Both are weighed by learned vectors and added, and the seventh layer makes the result (eq. 3).

    Where the source leaves a choice:
        The sum below the fraction of eq. 2 is printed as over channels, with which the result would grow with the
        number of points. It is taken over the points, so that any number of them is accepted.
        Weights are made positive by a softplus, as a sum of weights of any sign may be zero.
        Layers but the sixth and the seventh end in a layer normalization and a ReLU; the source names neither.

    Args:
        config: sizes.
    """

    def __init__(self, config: PointIdentityConfig) -> None:
        super().__init__()
        widths: Any = config.widths
        dim: Any = config.dim
        self.config, self.dim = config, int(dim)
        self._numbers = NUMBERS if config.box else NUMBERS - 3
        joined = widths[1] + widths[4]
        self.near = nn.Sequential(*map(_layer, *zip(*itertools.pairwise((self._numbers, *widths[:2])), strict=True)))
        self.far = nn.Sequential(*map(_layer, *zip(*itertools.pairwise(widths[1:]), strict=True)))
        self.attention = nn.Linear(widths[1], joined)
        self.local_scale = nn.Parameter(torch.ones(joined))
        self.global_scale = nn.Parameter(torch.ones(joined))
        self.last = nn.Linear(joined, self.dim)

    def forward(self, batch: PointBatch) -> Tensor:
        """Return vectors (M, D) of length 1; zeros for objects of fewer than five points."""
        near = self.near(batch.points[:, : self._numbers])
        features = torch.cat([near, self.far(near)], dim=1)
        weight = functional.softplus(self.attention(near))
        counts = batch.counts
        rows = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
        place = torch.arange(len(rows), device=counts.device) - (counts.cumsum(0) - counts)[rows]
        shape = (len(counts), max(int(counts.max()) if len(counts) else 0, 1), features.shape[1])
        largest = features.new_full(shape, -math.inf).index_put((rows, place), features).amax(1)
        zeros = features.new_zeros(len(counts), features.shape[1])
        total, weights = zeros.index_add(0, rows, features * weight), zeros.index_add(0, rows, weight)
        known = counts >= LEAST_POINTS
        local = total / torch.where(known[:, None], weights, 1.0)
        mixed = self.local_scale * local + self.global_scale * torch.where(known[:, None], largest, 0.0)
        return functional.normalize(self.last(mixed), dim=1) * known[:, None]


def _layer(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.ReLU())
