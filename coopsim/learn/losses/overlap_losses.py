"""GIoU and XIOU of pairs of boxes with gradients: the twins of `giou_3d` and `xiou` for training."""

from __future__ import annotations

import torch
from torch import Tensor

_PARALLEL = 1e-9
"""Sides whose direction differs by less run beside a line, or on it."""


def xiou_of_pairs(first: Tensor, second: Tensor) -> Tensor:
    """Return the XIOU (N,), in [0, 1], of boxes (N, 7) and (N, 7), as `coopsim.geometry.box_similarity.xiou` has it.

    Source: Hu, Wang and Wang, eq. 19-23; boxes are x, y, z, l, w, h, yaw.
    """
    agree = torch.cos(first[:, 6].double() - second[:, 6].double()) + 1
    return (giou_of_pairs(first, second).double() + 1).mul(agree).div(4).to(first.dtype)


def giou_of_pairs(first: Tensor, second: Tensor) -> Tensor:
    """Return the 3D GIoU (N,), in (-1, 1], of boxes (N, 7) and (N, 7), as `coopsim.geometry.iou.giou_3d` has it.

    It is computed in double precision: where boxes are alike, sides run on sides, and rounding decides what is inside.
    """
    kind = first.dtype
    first, second = first.double(), second.double()
    area, hull = _shared_area(first, second), _hull_area(first, second)
    rise, half, other = second[:, 2] - first[:, 2], first[:, 5] / 2, second[:, 5] / 2
    top, bottom = torch.minimum(rise + other, half), torch.maximum(rise - other, -half)
    depth = torch.maximum(rise + other, half) - torch.minimum(rise - other, -half)
    sizes = first[:, 3:6].prod(1), second[:, 3:6].prod(1)
    shared = torch.minimum(area * (top - bottom).clamp_min(0.0), torch.minimum(*sizes))
    union = sizes[0] + sizes[1] - shared
    enclosing = torch.maximum(hull * depth, union)
    return (shared / union - (enclosing - union) / enclosing).to(kind)


def _corners(box: Tensor, of: Tensor) -> Tensor:
    """Return the corners (N, 4, 2) of boxes, counter-clockwise, in the axes of the boxes `of`."""
    turn = box[:, 6] - of[:, 6]
    half = box[:, 3:5] / 2
    signs = box.new_tensor([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    middle = _turned(box[:, None, :2] - of[:, None, :2], -of[:, 6])
    return _turned(signs * half[:, None], turn) + middle


def _turned(points: Tensor, angle: Tensor) -> Tensor:
    """Return points (N, P, 2), turned by angles (N,)."""
    cos, sin = angle.cos()[:, None], angle.sin()[:, None]
    x, y = points.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y], dim=-1)


def _shared_area(first: Tensor, second: Tensor) -> Tensor:
    """Return the area (N,) that two footprints share, by Green's theorem.

    The border of what they share is what of each one's sides lies in the other. A part of a side from a to b adds half
    the cross product of a and b. A side that runs on the other's border counts once: as the first one's.
    """
    corners = _corners(second, first)
    total = torch.zeros_like(first[:, 0])
    for polygon, seen, half, border in (
        (_corners(first, first), _corners(first, second), second[:, 3:5] / 2, True),
        (corners, corners, first[:, 3:5] / 2, False),
    ):
        begin, end = _part_within(seen, half, border=border)
        start, along = polygon, polygon.roll(-1, 1) - polygon
        a, b = start + begin[..., None] * along, start + end[..., None] * along
        cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        total = total + torch.where(end > begin, cross, 0.0).sum(1) / 2
    return total.clamp_min(0.0)


def _part_within(polygon: Tensor, half: Tensor, *, border: bool) -> tuple[Tensor, Tensor]:
    """Return from where to where, (N, 4) each in [0, 1], sides are within |x| <= half[0], |y| <= half[1].

    Args:
        polygon: (N, 4, 2) corners; side k goes from corner k to the next one.
        half: (N, 2).
        border: a side that runs on the border is within.
    """
    along = polygon.roll(-1, 1) - polygon
    begin, end = torch.zeros_like(polygon[..., 0]), torch.ones_like(polygon[..., 0])
    for axis in (0, 1):
        for sign in (1.0, -1.0):  # room is how far within a corner is, and shrinks by `speed` along the side
            room, speed = half[:, None, axis] - sign * polygon[..., axis], sign * along[..., axis]
            beside = speed.abs() < _PARALLEL
            at = room / torch.where(beside, 1.0, speed)
            end = torch.where(~beside & (speed > 0), torch.minimum(end, at), end)
            begin = torch.where(~beside & (speed < 0), torch.maximum(begin, at), begin)
            within = room >= -_PARALLEL if border else room > _PARALLEL
            end = torch.where(beside & ~within, -torch.ones_like(end), end)
    return begin, end


def _hull_area(first: Tensor, second: Tensor) -> Tensor:
    """Return the area (N,) of the convex hull of two footprints.

    In the axes of the first, it is the upright box around both less what is cut off at its four corners. By symmetry
    each cut is that of the upper right one, in mirrored coordinates.
    """
    half_x, half_y = (first[:, 3:5] / 2).T
    x, y = _turned(second[:, None, :2] - first[:, None, :2], -first[:, 6])[:, 0].T
    right_x, right_y, top_x, top_y = _extremes(second[:, 3] / 2, second[:, 4] / 2, second[:, 6] - first[:, 6])
    width = torch.maximum(half_x, x + right_x) - torch.minimum(-half_x, x - right_x)
    height = torch.maximum(half_y, y + top_y) - torch.minimum(-half_y, y - top_y)
    cut = _cut(half_x, half_y, x + right_x, y + right_y, x + top_x, y + top_y)
    cut = cut + _cut(half_x, half_y, right_x - x, right_y - y, top_x - x, top_y - y)
    cut = cut + _cut(half_x, half_y, right_x - x, y - right_y, -top_x - x, y + top_y)
    cut = cut + _cut(half_x, half_y, x + right_x, -y - right_y, x - top_x, top_y - y)
    return width * height - cut


def _extremes(half_length: Tensor, half_width: Tensor, angle: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the rightmost and the topmost corner of rectangles around the origin, x and y of each, (N,).

    A rectangle turned by a quarter is one with its sides swapped, so any angle becomes one within the first quarter.
    """
    cos, sin = angle.cos(), angle.sin()
    swapped = cos * sin < 0
    length, across = torch.where(swapped, half_width, half_length), torch.where(swapped, half_length, half_width)
    cos, sin = torch.where(swapped, sin, cos).abs(), torch.where(swapped, cos, sin).abs()
    right = length * cos + across * sin, length * sin - across * cos
    return *right, length * cos - across * sin, length * sin + across * cos


def _cut(half_x: Tensor, half_y: Tensor, right_x: Tensor, right_y: Tensor, top_x: Tensor, top_y: Tensor) -> Tensor:
    """Return the area (N,) between the hull and the upper right corner of the box around it.

    The hull runs there from its rightmost to its topmost point. Only three points can lie on the way: the upright
    rectangle's corner, and the other's rightmost and topmost one. Two are the ends; the third bulges out, or not.
    """
    upright_first, upright_last = half_x >= right_x, half_y >= top_y
    first_x, first_y = torch.where(upright_first, half_x, right_x), torch.where(upright_first, half_y, right_y)
    last_x, last_y = torch.where(upright_last, half_x, top_x), torch.where(upright_last, half_y, top_y)
    x = torch.where(upright_first, right_x, torch.where(upright_last, top_x, half_x))
    y = torch.where(upright_first, right_y, torch.where(upright_last, top_y, half_y))
    left, up = first_x - last_x, last_y - first_y
    bulge = left * (y - first_y) + up * (x - first_x)
    area = (left * up - bulge.clamp_min(0.0)) / 2
    return torch.where(upright_first & upright_last, 0.0, area)
