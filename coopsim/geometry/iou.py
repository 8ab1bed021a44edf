"""Similarity of rotated boxes, all pairs at once: overlaps in 3D and in the bird's-eye view (BEV), distance, heading.

Boxes (N, 7) and (M, 7) are x, y, z, l, w, h, yaw, in one frame; values (N, M) are larger for more similar ones.

A pair is handled in the first box's own axes, where its footprint is an upright rectangle: it clips the other's in
four steps, and the hull of both follows from which corners stick out. The enclosing shape of GIoU is exact: the convex
hull of both footprints, times the joint height in 3D (Rezatofighi et al., CVPR 2019; Xu et al., "3D-GIoU", Sensors
2019; AB3DMOT uses the same). A pair with a box that is not a number overlaps by 0 or NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.support.kernels import njit

_MOST = 8  # corners: clipping a rectangle by four half-planes leaves at most eight

Footprint = tuple[float, float, float, float, float, float]
"""A box seen from above: its centre x, y m, its length and width m, the cosine and the sine of its heading."""

_Rectangle = tuple[float, float, float, float, float, float]
"""Its centre x, y in the first box's axes; then, relative to it, its rightmost and its topmost corner."""


def iou_3d(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return volume of intersection over union, (N, M) in [0, 1], of boxes (N, 7) and (M, 7)."""
    return _overlap(a, b, generalized=False)[0]


def giou_3d(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the 3D IoU less the empty share of the enclosing volume, (N, M) in (-1, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, generalized=True)[0]


def iou_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return area of intersection over union seen from above, (N, M) in [0, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, generalized=False)[1]


def giou_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the BEV IoU less the empty share of the convex hull, (N, M) in (-1, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, generalized=True)[1]


def iou_3d_and_bev(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    """Return `iou_3d` and `iou_bev` of (N, 7) and (M, 7), for the cost of one."""
    return _overlap(a, b, generalized=False)


def xiou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the XIOU, in [0, 1]: 3D GIoU times agreement of headings, (GIoU + 1) (cos(difference) + 1) / 4.

    Opposite headings give 0 whatever the overlap, so a detector must know front from back. The enclosing shape is that
    of `giou_3d`, an upright prism: convex, and the smallest such shape (eq. 20) where both boxes have the same floor
    and roof.

    Source: Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in
    Vehicle-Infrastructure Cooperation", eq. 19-23.
    """
    return (giou_3d(a, b) + 1) * (_same_heading(a, b) + 1) / 4


def axial_xiou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the XIOU, in [0, 1], of boxes whose front may be their back: (GIoU + 1) (|cos(difference)| + 1) / 4.

    It is `xiou` with the second box turned by half a turn where that makes it larger: for detectors that confuse front
    and back.
    """
    affinity: Floats = (giou_3d(a, b) + 1) * (np.abs(_same_heading(a, b)) + 1) / 4
    return affinity


def center_distance_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""
    return -_distance_m(*_boxes(a, b))


def fgam(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return F-GAM, in [0, 1]: 1 less the distance of centres in units of the smaller box, -inf beyond one.

    The source defines a cost: the distance of the centres on the ground over the smaller of the two footprints'
    diagonals, and rules a pair out where it exceeds 1. The affinity is 1 - cost, so that it adds to a similarity as the
    cost adds to a cost (its eq. 9), and no gate needs tuning. A box without a footprint is like no other.

    Source: Gu et al., "YOLOO: You Only Learn from Others Once", eq. 8.
    """
    first, second = _boxes(a, b)
    reach = np.minimum.outer(np.hypot(first[:, 3], first[:, 4]), np.hypot(second[:, 3], second[:, 4]))
    cost = np.divide(_distance_m(first, second), reach, out=np.full(reach.shape, np.inf), where=reach > 0)
    return np.where(cost <= 1, 1 - cost, -np.inf)


def _boxes(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    """Return boxes (N, 7) and (M, 7) as kernels take them."""
    rows = np.ascontiguousarray(frozen(a, (None, 7), np.float64, "first boxes"))
    return rows, np.ascontiguousarray(frozen(b, (None, 7), np.float64, "second boxes"))


def _distance_m(first: Floats, second: Floats) -> Floats:
    """Return the distances (N, M) m of centres on the ground."""
    distance_m: Floats = np.hypot(first[:, 0, None] - second[:, 0], first[:, 1, None] - second[:, 1])
    return distance_m


def _same_heading(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the cosine (N, M) of the differences of headings."""
    first, second = _boxes(a, b)
    cosine: Floats = np.cos(first[:, 6, None] - second[:, 6])
    return cosine


def _overlap(a: ArrayLike, b: ArrayLike, *, generalized: bool) -> tuple[Floats, Floats]:
    in_space, from_above = overlaps(*_boxes(a, b), generalized)
    return in_space, from_above


# Fast-math is off on purpose: exact ones for identical boxes are worth more than the few per cent.
@njit(cache=True, nogil=True)
def overlaps(a: Floats, b: Floats, generalized: bool) -> tuple[Floats, Floats]:
    """Return IoU, or GIoU if `generalized`, in 3D and in the BEV (N, M) of contiguous boxes (N, 7) and (M, 7)."""
    in_space, from_above = np.zeros((len(a), len(b))), np.zeros((len(a), len(b)))
    turns_a, turns_b, space = turns_of(a), turns_of(b), corner_space()
    for i in range(len(a)):
        for j in range(len(b)):
            if generalized or not are_apart(a, turns_a, i, b, turns_b, j):
                in_space[i, j], from_above[i, j] = pair_overlap(a, turns_a, i, b, turns_b, j, generalized, space)
    return in_space, from_above


@njit(cache=True, nogil=True)
def turns_of(boxes: Floats) -> Floats:
    """Return the cosine and sine of the heading, and the reach over ground m, of each box (N, 3)."""
    turns = np.empty((len(boxes), 3))
    for k in range(len(boxes)):
        turns[k, 0], turns[k, 1] = np.cos(boxes[k, 6]), np.sin(boxes[k, 6])
        turns[k, 2] = np.hypot(boxes[k, 3], boxes[k, 4]) / 2
    return turns


@njit(cache=True, nogil=True)
def are_apart(a: Floats, turns_a: Floats, i: int, b: Floats, turns_b: Floats, j: int) -> bool:
    """Return whether two footprints are too far apart to touch; `turns_of` gives the turns."""
    dx, dy, reach = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1], turns_a[i, 2] + turns_b[j, 2]
    apart: bool = dx * dx + dy * dy >= reach * reach
    return apart


@njit(cache=True, nogil=True)
def pair_overlap(
    a: Floats, turns_a: Floats, i: int, b: Floats, turns_b: Floats, j: int, generalized: bool, space: Floats
) -> tuple[float, float]:
    """Return IoU, or GIoU if `generalized`, in 3D and in the BEV of one box of a and one of b, as `overlaps` does."""
    half_x, half_y, half_a, area_a = a[i, 3] / 2, a[i, 4] / 2, a[i, 5] / 2, a[i, 3] * a[i, 4]
    cos_a, sin_a, cos_b, sin_b = turns_a[i, 0], turns_a[i, 1], turns_b[j, 0], turns_b[j, 1]
    dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
    other = _in_axes_of(dx, dy, cos_a, sin_a, cos_b, sin_b, b[j, 3] / 2, b[j, 4] / 2)
    apart = are_apart(a, turns_a, i, b, turns_b, j)
    shared = 0.0 if apart else _area_within(half_x, half_y, other, space)
    hull = _hull_area(half_x, half_y, other) if generalized else 0.0
    dz, half_b, area_b = b[j, 2] - a[i, 2], b[j, 5] / 2, b[j, 3] * b[j, 4]
    height = max(0.0, min(dz + half_b, half_a) - max(dz - half_b, -half_a))
    depth = max(dz + half_b, half_a) - min(dz - half_b, -half_a)
    in_space = _over_union(shared * height, area_a * a[i, 5], area_b * b[j, 5], depth * hull, generalized)
    return in_space, _over_union(shared, area_a, area_b, hull, generalized)


@njit(cache=True, nogil=True)
def _over_union(shared: float, size_a: float, size_b: float, enclosing: float, generalized: bool) -> float:
    """Return IoU or, less the empty share of an enclosing shape, GIoU; 0 of two shapes without a size."""
    inter = min(shared, size_a, size_b)  # rounding can make an intersection slightly larger than either
    union = size_a + size_b - inter
    if union <= 0:  # false for what is not a number
        return 0.0
    value: float = inter / union
    if generalized:
        enclosing = max(enclosing, union)
        value -= (enclosing - union) / enclosing
    return value


@njit(cache=True, nogil=True)
def corner_space() -> Floats:
    """Return space for the corners of two polygons, which `common_ground` writes to."""
    return np.empty((2, 2 * _MOST, 2))  # twice, for what rounding may add


@njit(cache=True, nogil=True)
def common_ground(a: Footprint, b: Footprint, space: Floats) -> float:
    """Return the area m^2 that two footprints share; `space` is from `corner_space`."""
    other = _in_axes_of(b[0] - a[0], b[1] - a[1], a[4], a[5], b[4], b[5], b[2] / 2, b[3] / 2)
    # Rounding can make an intersection slightly larger than either footprint.
    return min(_area_within(a[2] / 2, a[3] / 2, other, space), a[2] * a[3], b[2] * b[3])


@njit(cache=True, nogil=True)
def _in_axes_of(
    dx: float, dy: float, cos_a: float, sin_a: float, cos_b: float, sin_b: float, half_length: float, half_width: float
) -> _Rectangle:
    """Return the other's footprint, dx and dy from the first in common axes, in the first box's own axes."""
    cos, sin = cos_b * cos_a + sin_b * sin_a, sin_b * cos_a - cos_b * sin_a
    return (dx * cos_a + dy * sin_a, dy * cos_a - dx * sin_a, *_extremes(half_length, half_width, cos, sin))


@njit(cache=True, nogil=True)
def _extremes(half_length: float, half_width: float, cos: float, sin: float) -> tuple[float, float, float, float]:
    """Return the rightmost and topmost corner of a rectangle around the origin; their opposites are the others.

    A rectangle turned by a quarter is one with its sides swapped, so any heading becomes one in [0, 90) degrees,
    where each corner is extreme in one direction.
    """
    if sin == 0:
        cos = 1.0  # two equal headings are exactly parallel, which their rounded cosine would not say
    elif cos * sin < 0:
        half_length, half_width, cos, sin = half_width, half_length, sin, cos
    cos, sin = abs(cos), abs(sin)
    lx, ly, wx, wy = half_length * cos, half_length * sin, half_width * sin, half_width * cos
    return lx + wx, ly - wy, lx - wx, ly + wy


@njit(cache=True, nogil=True)
def _area_within(half_x: float, half_y: float, other: _Rectangle, space: Floats) -> float:
    """Return the area of the other rectangle within |x| <= half_x, |y| <= half_y (Sutherland and Hodgman 1974)."""
    x, y, right_x, right_y, top_x, top_y = other
    polygon, spare = space[0], space[1]
    if abs(x) >= half_x + right_x or abs(y) >= half_y + top_y:
        return 0.0
    polygon[0, 0], polygon[0, 1] = x + right_x, y + right_y
    polygon[1, 0], polygon[1, 1] = x + top_x, y + top_y
    polygon[2, 0], polygon[2, 1] = x - right_x, y - right_y
    polygon[3, 0], polygon[3, 1] = x - top_x, y - top_y
    count = _clip(polygon, 4, 0, half_x, 1.0, spare)
    count = _clip(spare, count, 0, half_x, -1.0, polygon)
    count = _clip(polygon, count, 1, half_y, 1.0, spare)
    count = _clip(spare, count, 1, half_y, -1.0, polygon)
    x, y, total = polygon[0, 0], polygon[0, 1], 0.0  # shoelace relative to a corner, for precision
    for k in range(1, count - 1):
        total += (polygon[k, 0] - x) * (polygon[k + 1, 1] - y) - (polygon[k + 1, 0] - x) * (polygon[k, 1] - y)
    return abs(total) / 2


@njit(cache=True, nogil=True)
def _clip(polygon: Floats, count: int, axis: int, limit: float, sign: float, out: Floats) -> int:
    """Clip a polygon to sign * coordinate <= limit, into `out`; return the number of its corners."""
    if count == 0:
        return 0
    kept = 0
    x, y = polygon[count - 1, 0], polygon[count - 1, 1]
    here = limit - sign * polygon[count - 1, axis]
    for k in range(count):
        next_x, next_y = polygon[k, 0], polygon[k, 1]
        there = limit - sign * polygon[k, axis]
        if (here > 0 and there < 0) or (here < 0 and there > 0):
            share = here / (here - there)
            out[kept, 0], out[kept, 1] = x + share * (next_x - x), y + share * (next_y - y)
            kept += 1
        if there >= 0:
            out[kept, 0], out[kept, 1] = next_x, next_y
            kept += 1
        x, y, here = next_x, next_y, there
    return kept


@njit(cache=True, nogil=True)
def _hull_area(half_x: float, half_y: float, other: _Rectangle) -> float:
    """Return the area of the convex hull of |x| <= half_x, |y| <= half_y and the other rectangle.

    The hull is the upright box around both less what is cut off at its four corners. By symmetry each cut is that of
    the upper right one, in mirrored coordinates.
    """
    x, y, right_x, right_y, top_x, top_y = other
    width = max(half_x, x + right_x) - min(-half_x, x - right_x)
    height = max(half_y, y + top_y) - min(-half_y, y - top_y)
    cut = _cut(half_x, half_y, x + right_x, y + right_y, x + top_x, y + top_y)
    cut += _cut(half_x, half_y, right_x - x, right_y - y, top_x - x, top_y - y)
    cut += _cut(half_x, half_y, right_x - x, y - right_y, -top_x - x, y + top_y)
    cut += _cut(half_x, half_y, x + right_x, -y - right_y, x - top_x, top_y - y)
    return width * height - cut


@njit(cache=True, nogil=True)
def _cut(half_x: float, half_y: float, right_x: float, right_y: float, top_x: float, top_y: float) -> float:
    """Return the area between the hull and the upper right corner of the box around it.

    The hull runs there from its rightmost to its topmost point. Only three points can lie on the way: the upright
    rectangle's corner, and the other's rightmost and topmost one. Two are the ends; the third bulges out, or not.
    """
    upright_first, upright_last = half_x >= right_x, half_y >= top_y
    if upright_first and upright_last:
        return 0.0
    if upright_first:
        first_x, first_y, last_x, last_y, x, y = half_x, half_y, top_x, top_y, right_x, right_y
    elif upright_last:
        first_x, first_y, last_x, last_y, x, y = right_x, right_y, half_x, half_y, top_x, top_y
    else:
        first_x, first_y, last_x, last_y, x, y = right_x, right_y, top_x, top_y, half_x, half_y
    left, up = first_x - last_x, last_y - first_y
    bulge = left * (y - first_y) + up * (x - first_x)
    return (left * up - max(0.0, bulge)) / 2
