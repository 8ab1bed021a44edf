"""LGPEnc, the local-global encoder of an object's points: seven layers and two learned vectors.

Gu et al., "YOLOO: You Only Learn from Others Once", section III-C2 and eq. 1 to 3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.inference.backend import PROCESSOR
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
        widths: widths of the first five layers; None: those of the size.
        dim: length of the vector; None: that of the size.
        points: most points of an object that are read; None: those of the size.
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
    """Encode the points of objects as unit vectors that tell them apart.

    The features of a point are those of the second and of the fifth layer. Their largest values over an object's points
    are its global part (eq. 1). Its local part is their mean, weighted by the sixth layer's output for the second's
    features (eq. 2). Both are weighed by learned vectors and added, and the seventh layer makes the result (eq. 3).

    Where the source leaves a choice: the sum below the fraction of eq. 2 is taken over the points, not over channels as
    printed, so that any number of points is accepted; weights are made positive by a softplus, since a sum of weights
    of any sign may be zero; layers but the sixth and the seventh end in a layer normalization and a ReLU.
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


LEAST_POINTS = 5
"""Fewer points are no appearance."""

NUMBERS = 7
"""Of a point: x, y, z m from the box's middle along its axes, intensity, and length, width and height of the box, m."""

_GIVEN = 4

_MARGIN_M = 0.15
"""What a box is larger on its sides and above; a detector's is seldom exact."""

_SOLE_M = 0.1
"""What it is shorter at the bottom, where the ground is."""

ObjectPoints = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class PointBatch:
    """Points (P, 7) of M objects, one object after the other, and the number (M,) of points of each, which may be 0."""

    points: Tensor
    counts: Tensor


def points_in_boxes(points: NDArray[np.floating], boxes: Floats, most: int) -> list[ObjectPoints]:
    """Return the points (n, 7), n <= most, in each box (N, 7), of points (P, 4 or more) x, y, z m and intensity.

    The result does not depend on the order of the points: they are sorted along the box, and if they are too many,
    every k-th is taken, so that both ends keep their share.
    """
    x, y = np.ascontiguousarray(points[:, :2].T)
    return [_inside(points, x, y, box, most) for box in boxes]


def join_points(objects: Sequence[ObjectPoints]) -> PointBatch:
    """Return the points of objects as a batch."""
    points = np.concatenate([np.zeros((0, NUMBERS), np.float32), *objects])
    return PointBatch(torch.from_numpy(points), torch.tensor([len(each) for each in objects], dtype=torch.int64))


def _inside(
    points: NDArray[np.floating], x: NDArray[np.floating], y: NDArray[np.floating], box: Floats, most: int
) -> ObjectPoints:
    reach = float(np.hypot(box[3], box[4])) / 2 + 2 * _MARGIN_M
    rows = np.flatnonzero(np.abs(x - float(box[0])) <= reach)
    rows = rows[np.abs(y[rows] - float(box[1])) <= reach]
    near = points[rows, :_GIVEN].astype(np.float64)
    dx, dy, z = near[:, 0] - box[0], near[:, 1] - box[1], near[:, 2] - box[2]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    inside = (
        (np.abs(ahead) <= box[3] / 2 + _MARGIN_M)
        & (np.abs(left) <= box[4] / 2 + _MARGIN_M)
        & (z >= _SOLE_M - box[5] / 2)
        & (z <= box[5] / 2 + _MARGIN_M)
    )
    found: ObjectPoints = np.column_stack([ahead, left, z, near[:, 3]])[inside].astype(np.float32)
    found = found[np.lexsort(found.T[::-1])]
    if len(found) > most:
        found = found[np.round(np.linspace(0, len(found) - 1, most)).astype(int)]
    return np.column_stack([found, np.broadcast_to(box[3:6].astype(np.float32), (len(found), 3))])


class PointEmbedder:
    """Vectors of the objects in boxes."""

    def __init__(self, net: PointIdentityNet) -> None:
        most: Any = net.config.points
        self._net, self._most, self.dim = net, int(most), net.dim

    def of(self, points: NDArray[np.floating], boxes: Floats) -> Floats:
        """Return vectors (N, D) of length 1; zeros where there are too few points, or a box is not finite.

        Args:
            points: (P, 4) x, y, z m and intensity.
            boxes: (N, 7) x, y, z, l, w, h, yaw in the same frame.
        """
        looks, finite = np.zeros((len(boxes), self.dim)), np.isfinite(boxes).all(axis=1)
        objects = points_in_boxes(points, boxes[finite], self._most)
        # Cosines of numbers of 8 bits would not tell much apart, and the network is small.
        with PROCESSOR.inference():
            looks[finite] = self._net(join_points(objects)).double().numpy()
        return looks
