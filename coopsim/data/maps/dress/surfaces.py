"""Surfaces of a map as convex pieces: strips along lanes, concave outlines, and what of them lies on no road."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from coopsim.data.maps.dress.field import Field, value_at
from coopsim.geometry import exact
from coopsim.geometry.outlines import convex_pieces, keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints

_STRAIGHT_M = 0.1  # strips through fewer points stay this close to the lane's edges
_SAMPLE_M = 1.0
_UNDER_LANE_M = 0.1  # that pavements may reach under a lane's edge: no slits
_SMALL_M = 1.5  # triangles at the edge of a road are divided until their sides are this short
_MOST_CORNERS = 12
_LEAST_M2 = 0.05


def strip(left: Floats, right: Floats) -> list[Floats]:
    """Return convex pieces (K, 2) m between two lines (N, 2) m side by side."""
    kept = keep_corners(np.column_stack([left, right]), _STRAIGHT_M)
    left, right = left[kept], right[kept]
    return split(np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1))


def split(surfaces: Floats) -> list[Floats]:
    """Return convex pieces (K, 2) m, counter-clockwise, of surfaces (N, K, 2) m with three or four corners."""
    corners, count = convex_pieces(np.ascontiguousarray(surfaces))
    pieces = [outline[:number] for outline, number in zip(corners, count.tolist(), strict=True)]
    return [piece if area_m2(piece) > 0 else piece[::-1] for piece in pieces]


@njit(cache=True, nogil=True)
def area_m2(outline: Floats) -> float:
    """Return the area within an outline (K, 2) m, less than zero if it is clockwise."""
    twice = 0.0
    for k in range(len(outline)):
        (x, y), (there_x, there_y) = outline[k - 1] - outline[0], outline[k] - outline[0]
        twice += x * there_y - there_x * y
    return twice / 2


def off_road(outlines: Sequence[Floats], field: Field) -> list[Floats]:
    """Return the parts of convex outlines (K, 2) m that lie on no road, as convex outlines."""
    free, on_edge = list[Floats](), [np.zeros((0, 3, 2))]
    for outline in outlines:
        corners = np.ascontiguousarray((outline - field.low) / field.step_m)
        least, most = _range_along(field.distance_m, corners, field.step_m)
        if least >= -_UNDER_LANE_M:
            free.append(outline)
        elif most > _UNDER_LANE_M:
            on_edge.append(np.stack([np.stack([corners[0], *pair]) for pair in pairwise(corners[1:])]))
    free += split(field.low + field.step_m * _clipped(np.concatenate(on_edge), field.distance_m, field.step_m))
    return [outline for outline in free if area_m2(outline) > _LEAST_M2]


@njit(cache=True, nogil=True)
def _range_along(distance_m: Floats, corners: Floats, step_m: float) -> tuple[float, float]:
    """Return the least and greatest distance at places, 1 m apart at most, along an outline (K, 2) and in its middle.

    The outline is in steps of the grid of distances (X, Y) m.
    """
    count = len(corners)
    least = most = value_at(distance_m, corners[:, 0].sum() / count, corners[:, 1].sum() / count)
    for k in range(count):
        ax, ay = corners[k - 1]
        along_x, along_y = corners[k, 0] - ax, corners[k, 1] - ay
        parts = int(np.sqrt(along_x * along_x + along_y * along_y) * step_m / _SAMPLE_M) + 1
        for n in range(parts):
            value = value_at(distance_m, ax + n / parts * along_x, ay + n / parts * along_y)
            least, most = min(least, value), max(most, value)
    return least, most


@njit(cache=True, nogil=True)
def _clipped(triangles: Floats, distance_m: Floats, step_m: float) -> Floats:
    """Return the parts (M, 4, 2) of triangles (T, 3, 2), in steps of the grid, where distances (X, Y) m are above 0."""
    found, size = np.empty((64, 4, 2)), 0
    stack, waiting = np.empty((len(triangles) + 64, 3, 2)), len(triangles)
    stack[:waiting] = triangles
    part, value = np.empty((3, 2)), np.empty(3)
    while waiting > 0:
        waiting -= 1
        part[:] = stack[waiting]
        longest, length = 0, -1.0
        for k in range(3):
            ahead_x, ahead_y = part[(k + 1) % 3, 0] - part[k, 0], part[(k + 1) % 3, 1] - part[k, 1]
            squared = ahead_x * ahead_x + ahead_y * ahead_y
            if squared > length:
                longest, length = k, squared
        least, most = _range_along(distance_m, part, step_m)
        if most < _UNDER_LANE_M:
            continue
        if least < -_UNDER_LANE_M and np.sqrt(length) * step_m > _SMALL_M:
            a, b = longest, (longest + 1) % 3
            for moved in (a, b):
                stack[waiting] = part
                stack[waiting, moved] = (part[a] + part[b]) / 2
                waiting += 1
            continue
        for k in range(3):
            value[k] = max(value_at(distance_m, part[k, 0], part[k, 1]), 0.0 if least >= -_UNDER_LANE_M else -np.inf)
        count = 0
        if size == len(found):
            found = np.concatenate((found, np.empty_like(found)))
        for k in range(3):
            there = (k + 1) % 3
            if value[k] >= 0:
                found[size, count] = part[k]
                count += 1
            if (value[k] >= 0) != (value[there] >= 0):
                found[size, count] = part[k] + value[k] / (value[k] - value[there]) * (part[there] - part[k])
                count += 1
        if count == 3:
            found[size, 3] = found[size, 2]
        size += count >= 3
    return found[:size]


def convex_parts(outline: Floats, most_m: float = 0.05) -> list[Floats]:
    """Return convex outlines (K, 2) m, counter-clockwise, that make up an outline which may be concave.

    The outline is simplified by at most `most_m`. Ears are cut off (Meisters 1975), and triangles joined again as long
    as they stay convex (Hertel and Mehlhorn 1983).
    """
    closed = np.concatenate([outline, outline[:1]])
    corners = closed[keep_corners(closed, most_m)][:-1]
    if len(corners) < 3:
        return []
    corners = corners if area_m2(corners) > 0 else np.ascontiguousarray(corners[::-1])
    parts = [tuple(each) for each in _ears(corners).tolist()]
    k = 0
    while k < len(parts):
        joined = next(((n, both) for n in range(k) if (both := _joined(parts[n], parts[k], corners))), None)
        if joined is None:
            k += 1
        else:
            n, both = joined
            parts[n] = both
            del parts[k]
            k = n
    found = [corners[list(each)] for each in parts]
    return [each for each in found if area_m2(each) > _LEAST_M2]


def _joined(one: tuple[int, ...], other: tuple[int, ...], corners: Floats) -> tuple[int, ...] | None:
    """Return two parts that share a side as one, if it is convex."""
    if len(one) + len(other) - 2 > _MOST_CORNERS:
        return None
    for k, first in enumerate(one):
        last = one[(k + 1) % len(one)]
        if first in other and other[other.index(first) - 1] == last:
            place = other.index(first)
            between = [other[(place + n) % len(other)] for n in range(1, len(other) - 1)]
            both = (*one[: k + 1], *between, *one[k + 1 :])
            if _are_left(corners[list(both)]):
                return both
    return None


def _are_left(outline: Floats) -> bool:
    """Return whether every corner (K, 2) turns to the left, or hardly to the right."""
    ahead = np.roll(outline, -1, axis=0) - outline
    after = np.roll(ahead, -1, axis=0)
    turn = ahead[:, 0] * after[:, 1] - ahead[:, 1] * after[:, 0]
    return bool((turn > -1e-3 * exact.norm(ahead + after, axis=1)).all())


@njit(cache=True, nogil=True)
def _ears(corners: Floats) -> Ints:
    """Return triangles (T, 3) of an outline's corners (K, 2), counter-clockwise; fewer where it crosses itself."""
    left, count = np.arange(len(corners)), len(corners)
    found, size = np.empty((len(corners), 3), np.int64), 0
    k, tried = 0, 0
    while count > 2 and tried < count:
        a, b, c = left[(k - 1) % count], left[k % count], left[(k + 1) % count]
        ear = _side(corners[a], corners[b], corners[c]) > 0
        for n in range(count if ear else 0):
            p = left[n]
            if p not in (a, b, c) and (
                _side(corners[a], corners[b], corners[p]) >= 0
                and _side(corners[b], corners[c], corners[p]) >= 0
                and _side(corners[c], corners[a], corners[p]) >= 0
            ):
                ear = False
                break
        flat = _side(corners[a], corners[b], corners[c]) == 0
        if ear or flat:
            if ear:
                found[size, 0], found[size, 1], found[size, 2] = a, b, c
                size += 1
            for n in range(k % count, count - 1):
                left[n] = left[n + 1]
            count, tried = count - 1, 0
        else:
            k, tried = k + 1, tried + 1
        k = k % max(count, 1)
    return found[:size]


@njit(cache=True, nogil=True)
def _side(a: Floats, b: Floats, c: Floats) -> float:
    return float((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]))
