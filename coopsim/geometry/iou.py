"""Overlap of rotated boxes, all pairs at once: IoU and GIoU in 3D and in the bird's-eye view (BEV).

A pair is handled in the first box's own axes, where its footprint is a plain rectangle that clips the other's
in four steps. The enclosing shape of GIoU is exact: the convex hull of both footprints, times the joint height
in 3D (Rezatofighi et al., CVPR 2019; Xu et al., "3D-GIoU", Sensors 2019; AB3DMOT uses the same).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from coopsim.arrays import frozen
from coopsim.geometry.se3 import Floats

_MOST = 8  # vertices: clipping a rectangle by four half-planes leaves at most eight; so does a hull of two


def iou_3d(a: ArrayLike, b: ArrayLike) -> Floats:
    """Volume of intersection over union, (N, M) in [0, 1], of boxes (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=True, generalized=False)


def giou_3d(a: ArrayLike, b: ArrayLike) -> Floats:
    """3D IoU less the empty share of the enclosing volume, (N, M) in (-1, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=True, generalized=True)


def iou_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Area of intersection over union seen from above, (N, M) in [0, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=False, generalized=False)


def giou_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """BEV IoU less the empty share of the convex hull, (N, M) in (-1, 1], of (N, 7) and (M, 7)."""
    return _overlap(a, b, volume=False, generalized=True)


def _overlap(a: ArrayLike, b: ArrayLike, *, volume: bool, generalized: bool) -> Floats:
    rows = np.ascontiguousarray(frozen(a, (None, 7), np.float64, "first boxes"))
    columns = np.ascontiguousarray(frozen(b, (None, 7), np.float64, "second boxes"))
    result: Floats = _all_pairs(rows, columns, volume, generalized)
    return result


# Fast-math is off on purpose: symmetry and exact ones for identical boxes are worth more than the few per cent.
@njit(cache=True, nogil=True)
def _all_pairs(a: Floats, b: Floats, volume: bool, generalized: bool) -> Floats:
    out = np.zeros((len(a), len(b)))
    reach_a, reach_b = np.hypot(a[:, 3], a[:, 4]) / 2, np.hypot(b[:, 3], b[:, 4]) / 2
    corners = np.empty((4, 2))
    polygon, clipped = np.empty((2 * _MOST, 2)), np.empty((2 * _MOST, 2))
    points, hull = np.empty((_MOST, 2)), np.empty((2 * _MOST, 2))
    for i in range(len(a)):
        cos, sin = np.cos(a[i, 6]), np.sin(a[i, 6])
        for j in range(len(b)):
            dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
            apart = np.hypot(dx, dy) >= reach_a[i] + reach_b[j]
            low = max(a[i, 2] - a[i, 5] / 2, b[j, 2] - b[j, 5] / 2)
            high = min(a[i, 2] + a[i, 5] / 2, b[j, 2] + b[j, 5] / 2)
            if not generalized and (apart or (volume and high <= low)):
                continue
            _footprint(dx * cos + dy * sin, dy * cos - dx * sin, b[j], b[j, 6] - a[i, 6], corners)
            inter = 0.0
            if not apart:
                inter = _clip_to_rectangle(corners, a[i, 3] / 2, a[i, 4] / 2, polygon, clipped)
            size_a, size_b, depth = a[i, 3] * a[i, 4], b[j, 3] * b[j, 4], 1.0
            if volume:
                inter *= max(0.0, high - low)
                size_a, size_b = size_a * a[i, 5], size_b * b[j, 5]
                depth = max(a[i, 2] + a[i, 5] / 2, b[j, 2] + b[j, 5] / 2)
                depth -= min(a[i, 2] - a[i, 5] / 2, b[j, 2] - b[j, 5] / 2)
            # Rounding can make an intersection a hair larger than what it is an intersection of.
            inter = min(inter, size_a, size_b)
            union = size_a + size_b - inter
            if union <= 0:
                continue
            out[i, j] = inter / union
            if generalized:
                enclosing = depth * _hull_area(corners, a[i, 3] / 2, a[i, 4] / 2, points, hull)
                enclosing = max(enclosing, union)
                out[i, j] -= (enclosing - union) / enclosing
    return out


@njit(cache=True, nogil=True)
def _footprint(x: float, y: float, box: Floats, yaw: float, corners: Floats) -> None:
    """Corners of a box at (x, y) with heading `yaw`, counter-clockwise."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    lx, ly = box[3] / 2 * cos, box[3] / 2 * sin
    wx, wy = -box[4] / 2 * sin, box[4] / 2 * cos
    corners[0, 0], corners[0, 1] = x + lx + wx, y + ly + wy
    corners[1, 0], corners[1, 1] = x - lx + wx, y - ly + wy
    corners[2, 0], corners[2, 1] = x - lx - wx, y - ly - wy
    corners[3, 0], corners[3, 1] = x + lx - wx, y + ly - wy


@njit(cache=True, nogil=True)
def _clip_to_rectangle(corners: Floats, half_x: float, half_y: float, polygon: Floats, clipped: Floats) -> float:
    """Area of a convex polygon within |x| <= half_x, |y| <= half_y (Sutherland and Hodgman 1974)."""
    count = 4
    polygon[:4] = corners
    for axis in range(2):
        limit = half_x if axis == 0 else half_y
        for sign in (1.0, -1.0):
            kept = 0
            for k in range(count):
                after = k + 1 if k + 1 < count else 0
                here = limit - sign * polygon[k, axis]
                there = limit - sign * polygon[after, axis]
                if here >= 0:
                    clipped[kept] = polygon[k]
                    kept += 1
                if (here > 0 and there < 0) or (here < 0 and there > 0):
                    share = here / (here - there)
                    clipped[kept, 0] = polygon[k, 0] + share * (polygon[after, 0] - polygon[k, 0])
                    clipped[kept, 1] = polygon[k, 1] + share * (polygon[after, 1] - polygon[k, 1])
                    kept += 1
            polygon[:kept] = clipped[:kept]
            count = kept
            if count < 3:
                return 0.0
    return _area(polygon, count)


@njit(cache=True, nogil=True)
def _hull_area(corners: Floats, half_x: float, half_y: float, points: Floats, hull: Floats) -> float:
    """Area of the convex hull of a polygon's 4 corners and a rectangle's (Andrew's monotone chain)."""
    points[:4] = corners
    points[4, 0], points[4, 1] = half_x, half_y
    points[5, 0], points[5, 1] = -half_x, half_y
    points[6, 0], points[6, 1] = -half_x, -half_y
    points[7, 0], points[7, 1] = half_x, -half_y
    for k in range(1, _MOST):
        x, y = points[k, 0], points[k, 1]
        slot = k
        while slot > 0 and (points[slot - 1, 0] > x or (points[slot - 1, 0] == x and points[slot - 1, 1] > y)):
            points[slot] = points[slot - 1]
            slot -= 1
        points[slot, 0], points[slot, 1] = x, y
    count = _chain(points, hull, 0, forward=True)
    count = _chain(points, hull, count - 1, forward=False)
    return _area(hull, count - 1)


@njit(cache=True, nogil=True)
def _chain(points: Floats, hull: Floats, start: int, forward: bool) -> int:
    """Append the lower (or, backwards, the upper) half of the hull from index `start`; the new length."""
    count = start
    for k in range(_MOST):
        p = points[k] if forward else points[_MOST - 1 - k]
        while count >= start + 2:
            ax, ay = hull[count - 1, 0] - hull[count - 2, 0], hull[count - 1, 1] - hull[count - 2, 1]
            bx, by = p[0] - hull[count - 2, 0], p[1] - hull[count - 2, 1]
            if ax * by - ay * bx > 0:
                break
            count -= 1
        hull[count, 0], hull[count, 1] = p[0], p[1]
        count += 1
    return count


@njit(cache=True, nogil=True)
def _area(polygon: NDArray[np.float64], count: int) -> float:
    """Area of a polygon's first `count` vertices (shoelace), relative to its first for precision."""
    total = 0.0
    x, y = polygon[0, 0], polygon[0, 1]
    for k in range(1, count - 1):
        total += (polygon[k, 0] - x) * (polygon[k + 1, 1] - y) - (polygon[k + 1, 0] - x) * (polygon[k, 1] - y)
    return abs(total) / 2
