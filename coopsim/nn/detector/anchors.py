"""Anchors: boxes of one size at every cell of a grid and at fixed headings, and boxes coded relative to them.

The code is SECOND's (Yan et al., "SECOND: Sparsely Embedded Convolutional Detection", Sensors 2018, eq. 1-3), as
PointPillars (Lang et al., CVPR 2019, eq. 1) and OpenCOOD use it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_finite_number, require_positive
from coopsim.types import BevGrid, Ints

CODE = 7
"""Numbers of a code: x, y, z, l, w, h, yaw, each relative to an anchor's."""


@dataclass(frozen=True, slots=True)
class AnchorConfig:
    """Anchors of one size, one per heading at the middle of each cell.

    The defaults are those of OpenCOOD, whose z of -1 m counts from the LiDAR; here a frame's origin is on the ground,
    on which the anchors stand.

    Attributes:
        size_m: length, width, height.
        z_m: height of the anchors' centres over the ground.
        yaw_rad: headings in the grid's frame.
    """

    size_m: tuple[float, float, float] = (3.9, 1.6, 1.56)
    z_m: float = 0.78
    yaw_rad: tuple[float, ...] = (0.0, math.pi / 2)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size_m", tuple(float(value) for value in self.size_m))
        object.__setattr__(self, "yaw_rad", tuple(float(value) for value in self.yaw_rad))
        require_finite_number(z_m=self.z_m, **{f"yaw_rad[{k}]": yaw for k, yaw in enumerate(self.yaw_rad)})
        require_positive(**{f"size_m[{k}]": size for k, size in enumerate(self.size_m)})
        if len(self.size_m) != 3 or not self.yaw_rad:
            raise InvalidValueError(
                f"anchors need a length, width and height and at least one heading, got {self.size_m}, {self.yaw_rad}"
            )

    @property
    def diagonal_m(self) -> float:
        """Diagonal of an anchor's footprint."""
        return math.hypot(self.size_m[0], self.size_m[1])


def anchor_boxes(grid: BevGrid, config: AnchorConfig, index: Ints | None = None) -> Floats:
    """Return the anchors (K, 7) with numbers `index` (K,), or all of a grid.

    Anchors are numbered as (headings, rows, columns). An anchor is at the middle of its cell, whatever the cell's size.
    """
    rows, columns = grid.shape
    number = np.arange(len(config.yaw_rad) * rows * columns) if index is None else index
    heading, row, column = np.unravel_index(number, (len(config.yaw_rad), rows, columns))
    boxes = np.empty((len(number), CODE))
    boxes[:, 0] = grid.x_m[0] + (column + 0.5) * grid.cell_m
    boxes[:, 1] = grid.y_m[0] + (row + 0.5) * grid.cell_m
    boxes[:, 2], boxes[:, 3:6] = config.z_m, config.size_m
    boxes[:, 6] = np.array(config.yaw_rad)[heading]
    return boxes


def encode_relative(boxes: Tensor, anchors: Tensor) -> Tensor:
    """Return the codes (K, 7) of boxes (K, 7) relative to an anchor each (K, 7).

    x and y differ in diagonals of the anchor's footprint, z in its heights, sizes by the logarithm of their ratio, and
    the heading in rad.
    """
    diagonal = torch.linalg.vector_norm(anchors[:, 3:5], dim=1, keepdim=True)
    return torch.cat(
        [
            (boxes[:, :2] - anchors[:, :2]) / diagonal,
            (boxes[:, 2:3] - anchors[:, 2:3]) / anchors[:, 5:6],
            torch.log(boxes[:, 3:6] / anchors[:, 3:6]),
            boxes[:, 6:] - anchors[:, 6:],
        ],
        dim=1,
    )


def decode_relative(codes: Tensor, anchors: Tensor) -> Tensor:
    """Return the boxes (K, 7) of codes (K, 7): the inverse of `encode_relative`. Headings are not wrapped."""
    diagonal = torch.linalg.vector_norm(anchors[:, 3:5], dim=1, keepdim=True)
    return torch.cat(
        [
            codes[:, :2] * diagonal + anchors[:, :2],
            codes[:, 2:3] * anchors[:, 5:6] + anchors[:, 2:3],
            torch.exp(codes[:, 3:6]) * anchors[:, 3:6],
            codes[:, 6:] + anchors[:, 6:],
        ],
        dim=1,
    )


def turn_to_side(code_yaw: Tensor, backwards: Tensor) -> Tensor:
    """Return heading differences (K,) rad turned by half a turn where needed, so that they face the side (K,) bool.

    A heading within a quarter turn of its anchor's looks forwards, others backwards. The loss of the codes knows
    headings but for half a turn; which half it is says the direction classifier.
    """
    forwards = torch.remainder(code_yaw + math.pi / 2, math.pi) - math.pi / 2
    return forwards + math.pi * backwards.to(forwards.dtype)
