"""The points of an object: those in its box, in the box's own frame, at most so many, in an order of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import Floats

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
    """The points of M objects, one after the other.

    Attributes:
        points: (P, 7), of the first object, then of the second.
        counts: (M,) how many are of each object; 0 is accepted.
    """

    points: Tensor
    counts: Tensor


def points_in_boxes(points: NDArray[np.floating], boxes: Floats, most: int) -> list[ObjectPoints]:
    """Return of each box the points in it (n, 7), n <= most.

    The result does not depend on the order of the points: they are sorted along the box, and if they are too many,
    every so many-th is taken, so that both ends keep their share.

    Args:
        points: (P, 4 or more) x, y, z m and intensity, in the frame of the boxes.
        boxes: (N, 7) x, y, z, l, w, h, yaw.
        most: points of a box that are kept.
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
