"""Overlap of rotated boxes, all pairs at once: IoU and GIoU in 3D and in the bird's-eye view (BEV).

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

_Angles = tuple[float, float, float, float]
"""Cosine and sine of the first box's yaw, then of the second's."""

_Rectangle = tuple[float, float, float, float, float, float]
"""Its centre x, y in the first box's axes; then, relative to it, its rightmost and its topmost corner."""


def iou_3d(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return volume of intersection over union, (N, M) in [0, 1], of boxes (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=True, generalized=False)


def giou_3d(a: ArrayLike, b: ArrayLike, least: float = -np.inf) -> Floats:
    """Return the 3D IoU less the empty share of the enclosing volume, (N, M) in (-1, 1], of (N, 7) and (M, 7).

    Args:
        a: (N, 7).
        b: (M, 7).
        least: smaller values are returned as this one, which saves the computation of most pairs that lie far apart.
    """
    return _overlap(a, b, volume=True, generalized=True, least=least)


def iou_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return area of intersection over union seen from above, (N, M) in [0, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=False, generalized=False)


def giou_bev(a: ArrayLike, b: ArrayLike, least: float = -np.inf) -> Floats:
    """Return the BEV IoU less the empty share of the convex hull, (N, M) in (-1, 1], of (N, 7) and (M, 7).

    Args:
        a: (N, 7).
        b: (M, 7).
        least: as in `giou_3d`.
    """
    return _overlap(a, b, volume=False, generalized=True, least=least)


def iou_3d_and_bev(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    """Return `iou_3d` and `iou_bev` of (N, 7) and (M, 7), for hardly more than the cost of one."""
    in_space, from_above = _both_overlaps(*_checked(a, b))
    return in_space, from_above


def _overlap(a: ArrayLike, b: ArrayLike, *, volume: bool, generalized: bool, least: float = -np.inf) -> Floats:
    result: Floats = _all_pairs(*_checked(a, b), volume, generalized, least)
    return result


def _checked(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    rows = np.ascontiguousarray(frozen(a, (None, 7), np.float64, "first boxes"))
    return rows, np.ascontiguousarray(frozen(b, (None, 7), np.float64, "second boxes"))


# Fast-math is off on purpose: exact ones for identical boxes are worth more than the few per cent.
@njit(cache=True, nogil=True)
def _all_pairs(a: Floats, b: Floats, volume: bool, generalized: bool, least: float) -> Floats:
    out = np.zeros((len(a), len(b)))
    far = _far(least) if generalized else np.inf
    reach_a, reach_b = np.hypot(a[:, 3], a[:, 4]) / 2, np.hypot(b[:, 3], b[:, 4]) / 2
    width_a, width_b = _widths(a), _widths(b)
    area_a, area_b = far * (a[:, 3] * a[:, 4]), far * (b[:, 3] * b[:, 4])
    cos_a, sin_a, cos_b, sin_b = np.cos(a[:, 6]), np.sin(a[:, 6]), np.cos(b[:, 6]), np.sin(b[:, 6])
    room = corner_room()
    for i in range(len(a)):
        half_x, half_y = a[i, 3] / 2, a[i, 4] / 2
        for j in range(len(b)):
            dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
            reach = reach_a[i] + reach_b[j]
            apart = dx * dx + dy * dy >= reach * reach
            if apart and far < np.inf and width_a[i] > 0 and width_b[j] > 0:
                width, area = width_a[i] + width_b[j], area_a[i] + area_b[j]
                if (dx * dx + dy * dy) * (width * width) > area * area:
                    out[i, j] = least
                    continue
            dz, half_a, half_b = b[j, 2] - a[i, 2], a[i, 5] / 2, b[j, 5] / 2
            low, high = max(dz - half_b, -half_a), min(dz + half_b, half_a)
            if not generalized and (apart or (volume and high <= low)):
                continue
            other = _in_axes_of(dx, dy, cos_a[i], sin_a[i], cos_b[j], sin_b[j], b[j, 3] / 2, b[j, 4] / 2)
            inter = 0.0 if apart else _area_within(half_x, half_y, other, room)
            size_a, size_b, depth = a[i, 3] * a[i, 4], b[j, 3] * b[j, 4], 1.0
            if volume:
                inter *= max(0.0, high - low)
                size_a, size_b = size_a * a[i, 5], size_b * b[j, 5]
                depth = max(dz + half_b, half_a) - min(dz - half_b, -half_a)
            # Rounding can make an intersection slightly larger than either box.
            inter = min(inter, size_a, size_b)
            union = size_a + size_b - inter
            if union <= 0:
                continue
            out[i, j] = inter / union
            if generalized:
                enclosing = depth * _hull_area(half_x, half_y, other)
                enclosing = max(enclosing, union)
                out[i, j] -= (enclosing - union) / enclosing
                if out[i, j] < least:  # false for what is not a number
                    out[i, j] = least
    return out


@njit(cache=True, nogil=True)
def _widths(boxes: Floats) -> Floats:
    """Return the smaller side (N,) of each footprint, 0 for a box without volume."""
    width = np.zeros(len(boxes))
    for k in range(len(boxes)):
        if boxes[k, 3] > 0 and boxes[k, 4] > 0 and boxes[k, 5] > 0:
            width[k] = min(boxes[k, 3], boxes[k, 4])
    return width


@njit(cache=True, nogil=True)
def _far(least: float) -> float:
    """Return f such that the GIoU of two disjoint footprints is below `least` beyond the distance f A / W.

    A is the sum of their areas, W the sum of their smaller sides. At a distance d of their centres the hull has at
    least the area (d W + A) / 2: the half of each footprint that is turned away from the other, and between them a
    trapezium. So the GIoU is at most 2 A / (d W + A) - 1; in 3D too, where the joint height is at least that of either.
    """
    if least <= -1:
        return np.inf
    return (2 / (1 + least) - 1) * (1 + 1e-9)  # more than rounding


@njit(cache=True, nogil=True)
def _both_overlaps(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return IoU in 3D and in the BEV as `_all_pairs` does, with each footprint clipped once."""
    in_space, from_above = np.zeros((len(a), len(b))), np.zeros((len(a), len(b)))
    reach_a, reach_b = np.hypot(a[:, 3], a[:, 4]) / 2, np.hypot(b[:, 3], b[:, 4]) / 2
    cos_a, sin_a, cos_b, sin_b = np.cos(a[:, 6]), np.sin(a[:, 6]), np.cos(b[:, 6]), np.sin(b[:, 6])
    room = corner_room()
    for i in range(len(a)):
        for j in range(len(b)):
            dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
            reach = reach_a[i] + reach_b[j]
            if dx * dx + dy * dy >= reach * reach:
                continue
            angles = (cos_a[i], sin_a[i], cos_b[j], sin_b[j])
            in_space[i, j], from_above[i, j] = overlaps_of_pair(a[i], b[j], angles, room)
    return in_space, from_above


@njit(cache=True, nogil=True)
def overlaps_of_pair(a: Floats, b: Floats, angles: _Angles, room: Floats) -> tuple[float, float]:
    """Return IoU in 3D and in the BEV of two boxes (7,) that are near, for kernels that gate pairs themselves.

    Args:
        a: the first box.
        b: the second box.
        angles: cosine and sine of the first's yaw, then of the second's.
        room: from `corner_room`.
    """
    area, height = _common_area(a, b, angles, room), _common_height(a, b)
    size_a, size_b = a[3] * a[4], b[3] * b[4]
    in_space = _over_union(area * height, size_a * a[5], size_b * b[5]) if height > 0 else 0.0
    return in_space, _over_union(area, size_a, size_b)


@njit(cache=True, nogil=True)
def bev_overlap(a: Floats, b: Floats, angles: _Angles, room: Floats) -> float:
    """Return `iou_bev` of two boxes (7,); see `overlaps_of_pair`."""
    return _over_union(_common_area(a, b, angles, room), a[3] * a[4], b[3] * b[4])


@njit(cache=True, nogil=True)
def overlap_3d(a: Floats, b: Floats, angles: _Angles, room: Floats) -> float:
    """Return `iou_3d` of two boxes (7,); see `overlaps_of_pair`."""
    height = _common_height(a, b)
    if not height > 0:
        return 0.0
    area = _common_area(a, b, angles, room)
    return _over_union(area * height, a[3] * a[4] * a[5], b[3] * b[4] * b[5])


@njit(cache=True, nogil=True)
def _common_area(a: Floats, b: Floats, angles: _Angles, room: Floats) -> float:
    """Return the area m^2 that the footprints of two boxes (7,) share."""
    cos_a, sin_a, cos_b, sin_b = angles
    other = _in_axes_of(b[0] - a[0], b[1] - a[1], cos_a, sin_a, cos_b, sin_b, b[3] / 2, b[4] / 2)
    return _area_within(a[3] / 2, a[4] / 2, other, room)


@njit(cache=True, nogil=True)
def _common_height(a: Floats, b: Floats) -> float:
    """Return the height m that two boxes (7,) share; not above 0 if one is above the other."""
    dz, half_a, half_b = b[2] - a[2], a[5] / 2, b[5] / 2
    height: float = min(dz + half_b, half_a) - max(dz - half_b, -half_a)
    return height


@njit(cache=True, nogil=True)
def _over_union(inter: float, size_a: float, size_b: float) -> float:
    inter = min(inter, size_a, size_b)
    union = size_a + size_b - inter
    return inter / union if union > 0 else 0.0


@njit(cache=True, nogil=True)
def corner_room() -> Floats:
    """Return room for the corners of two polygons, which the functions of one pair write to."""
    return np.empty((2, 2 * _MOST, 2))  # twice, for what rounding may add


@njit(cache=True, nogil=True)
def common_ground(a: Footprint, b: Footprint, room: Floats) -> float:
    """Return the area m^2 that two footprints share; `room` is from `corner_room`."""
    other = _in_axes_of(b[0] - a[0], b[1] - a[1], a[4], a[5], b[4], b[5], b[2] / 2, b[3] / 2)
    # Rounding can make an intersection slightly larger than either footprint.
    return min(_area_within(a[2] / 2, a[3] / 2, other, room), a[2] * a[3], b[2] * b[3])


@njit(cache=True, nogil=True)
def iou_3d_of_pair(a: Footprint, b: Footprint, rise: float, height_a: float, height_b: float, room: Floats) -> float:
    """Return the number that `iou_3d` has for two boxes, of which b lies `rise` m higher; see `common_ground`."""
    low, high = max(rise - height_b / 2, -height_a / 2), min(rise + height_b / 2, height_a / 2)
    if high <= low:
        return 0.0
    size_a, size_b = a[2] * a[3] * height_a, b[2] * b[3] * height_b
    return _over_union(common_ground(a, b, room) * (high - low), size_a, size_b)


@njit(cache=True, nogil=True)
def giou_bev_of_pair(a: Footprint, b: Footprint, room: Floats) -> float:
    """Return the number that `giou_bev` has for two boxes; `room` is from `corner_room`."""
    other = _in_axes_of(b[0] - a[0], b[1] - a[1], a[4], a[5], b[4], b[5], b[2] / 2, b[3] / 2)
    area_a, area_b = a[2] * a[3], b[2] * b[3]
    inter = min(_area_within(a[2] / 2, a[3] / 2, other, room), area_a, area_b)
    union = area_a + area_b - inter
    if union <= 0:
        return 0.0
    enclosing = max(_hull_area(a[2] / 2, a[3] / 2, other), union)
    return inter / union - (enclosing - union) / enclosing


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
def _area_within(half_x: float, half_y: float, other: _Rectangle, room: Floats) -> float:
    """Return the area of the other rectangle within |x| <= half_x, |y| <= half_y (Sutherland and Hodgman 1974)."""
    x, y, right_x, right_y, top_x, top_y = other
    polygon, spare = room[0], room[1]
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
