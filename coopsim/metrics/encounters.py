"""Encounters of bodies on the ground, compiled: gaps, times until bodies touch, and tracks on them.

A body is a row of five numbers: x, y, length, width, m, and yaw, rad. A row of NaN is absent, and touches nothing.
"""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints


@njit(cache=True, nogil=True)
def clearance(a: Floats, b: Floats) -> float:
    """Return the gap between two bodies, m: the widest along their four axes, negative where they overlap.

    It is the distance of bodies that face each other, and less than it where corner meets corner. NaN if one is absent.
    """
    widest = -math.inf
    dx, dy = b[0] - a[0], b[1] - a[1]
    if not math.isfinite(dx + dy):
        return math.nan
    for heading in (a[4], b[4]):  # numbers: bodies may lie in memory in two ways, of which no tuple can be gone through
        cos, sin = math.cos(heading), math.sin(heading)
        for x, y in ((cos, sin), (-sin, cos)):
            apart = abs(dx * x + dy * y) - _half_extent(a, x, y) - _half_extent(b, x, y)
            widest = max(widest, apart)
    return widest


@njit(cache=True, nogil=True)
def _half_extent(body: Floats, x: float, y: float) -> float:
    cos, sin = math.cos(body[4]), math.sin(body[4])
    half: float = (body[2] * abs(cos * x + sin * y) + body[3] * abs(cos * y - sin * x)) / 2
    return half


@njit(cache=True, nogil=True)
def _reach(body: Floats) -> float:
    return math.hypot(body[2], body[3]) / 2


@njit(cache=True, nogil=True)
def _touch(a: Floats, b: Floats) -> bool:
    """Return whether two bodies overlap."""
    near = _reach(a) + _reach(b)
    if not (abs(b[0] - a[0]) < near and abs(b[1] - a[1]) < near):
        return False
    return clearance(a, b) < 0


@njit(cache=True, nogil=True)
def clearances(body: Floats, others: Floats) -> Floats:
    """Return the gaps (A,) m between a body (5,) and others (A, 5); infinite for the absent."""
    gaps = np.empty(len(others))
    for k in range(len(others)):
        gap = clearance(body, others[k])
        gaps[k] = gap if math.isfinite(gap) else math.inf
    return gaps


@njit(cache=True, nogil=True)
def least_time(ahead: Floats, boxes: Floats, speed: Floats, dt_s: float, limit_s: float) -> float:
    """Return the least time to collision of all frames, s, at most `limit_s`.

    Both go on at their present speeds along their paths: the car along its way, an object along the path that it then
    truly takes, and straight on from its end.

    Args:
        ahead: (F, H, 5) bodies of the car after 0, 1, ..., H - 1 steps along its way.
        boxes: (S, A, 5) bodies of objects in the same frames, and perhaps in later ones.
        speed: (F, A) m/s of the objects; NaN leaves one out of a frame.
        dt_s: time of a step.
        limit_s: longest time.
    """
    least, other = limit_s, np.empty(5)
    for i in range(len(ahead)):
        travels = math.hypot(ahead[i, -1, 0] - ahead[i, 0, 0], ahead[i, -1, 1] - ahead[i, 0, 1])
        for k in range(boxes.shape[1]):
            near = travels + speed[i, k] * least + _reach(ahead[i, 0]) + _reach(boxes[i, k])
            if not math.hypot(boxes[i, k, 0] - ahead[i, 0, 0], boxes[i, k, 1] - ahead[i, 0, 1]) < near:
                continue
            j, passed, before = i, 0.0, 0.0
            for step in range(ahead.shape[1]):
                if (step - 1) * dt_s >= least:
                    break
                j, passed = _advance(boxes, k, j, passed, speed[i, k] * step * dt_s, other)
                gap = clearance(ahead[i, step], other)
                if gap < 0:
                    # Between two steps the gap shrinks evenly.
                    least = min(least, (step - gap / (gap - before)) * dt_s if step else 0.0)
                    break
                before = gap
    return least


@njit(cache=True, nogil=True)
def _advance(boxes: Floats, k: int, j: int, passed: float, wanted: float, out: Floats) -> tuple[int, float]:
    """Put the body of object `k` after `wanted` m of its path into `out`; frame `j` of it is reached after `passed` m.

    Return the last frame that is reached, and the metres up to it.
    """
    while j + 1 < len(boxes) and math.isfinite(boxes[j + 1, k, 0]):
        step = math.hypot(boxes[j + 1, k, 0] - boxes[j, k, 0], boxes[j + 1, k, 1] - boxes[j, k, 1])
        if passed + step > wanted:
            break
        passed += step
        j += 1
    out[:] = boxes[j, k]
    rest = wanted - passed
    if rest > 0:
        direction = out[4]
        if j + 1 < len(boxes) and math.isfinite(boxes[j + 1, k, 0]):
            direction = math.atan2(boxes[j + 1, k, 1] - boxes[j, k, 1], boxes[j + 1, k, 0] - boxes[j, k, 0])
        out[0] += rest * math.cos(direction)
        out[1] += rest * math.sin(direction)
    return j, passed


@njit(cache=True, nogil=True)
def least_delay(car: Floats, boxes: Floats, most: int, least_angle: float) -> tuple[int, int]:
    """Find the shortest time between a car and an object on the same ground.

    Args:
        car: (T, 5) bodies of the car.
        boxes: (S, A, 5) bodies of objects in the same frames, and perhaps in more.
        most: longest time, in frames.
        least_angle: smallest angle between the headings of both, rad.

    Returns:
        The time in frames, and the car's frame; -1 and -1 if there is none. Of equal times the first counts.
    """
    best, when = most + 1, -1
    low_x, high_x, low_y, high_y = _grounds(boxes)
    for i in range(len(car)):
        for k in range(boxes.shape[1]):
            x, y, reach = car[i, 0], car[i, 1], _reach(car[i])
            if not (low_x[k] - reach < x < high_x[k] + reach and low_y[k] - reach < y < high_y[k] + reach):
                continue
            for j in range(max(i - best + 1, 0), min(i + best, len(boxes))):
                if not _touch(car[i], boxes[j, k]):
                    continue
                turned = (boxes[j, k, 4] - car[i, 4] + math.pi) % (2 * math.pi) - math.pi
                if abs(turned) >= least_angle and abs(i - j) < best:
                    best, when = abs(i - j), i
        if best == 0:
            break
    return (best, when) if when >= 0 else (-1, -1)


@njit(cache=True, nogil=True)
def _grounds(boxes: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the least and largest x and y (A,) m of the ground that objects (S, A, 5) ever cover."""
    count = boxes.shape[1]
    low_x, high_x = np.full(count, math.inf), np.full(count, -math.inf)
    low_y, high_y = np.full(count, math.inf), np.full(count, -math.inf)
    for j in range(len(boxes)):
        for k in range(count):
            if math.isfinite(boxes[j, k, 0]):
                x, y, reach = boxes[j, k, 0], boxes[j, k, 1], _reach(boxes[j, k])
                low_x[k], high_x[k] = min(low_x[k], x - reach), max(high_x[k], x + reach)
                low_y[k], high_y[k] = min(low_y[k], y - reach), max(high_y[k], y + reach)
    return low_x, high_x, low_y, high_y


@njit(cache=True, nogil=True)
def is_on(tracks: Floats, track_kind: Ints, objects: Floats, kind: Ints, wanted: int, near_m: float) -> bool:
    """Return whether a track is on an object: within `near_m` of its middle, or over it, and of no other one's.

    Args:
        tracks: (M, 5) bodies of tracks.
        track_kind: (M,) only those of the object's kind count.
        objects: (A, 5) bodies of objects; a track belongs to the nearest one of its kind.
        kind: (A,) of the objects.
        wanted: row of the object.
        near_m: distance between the middles.
    """
    for t in range(len(tracks)):
        if track_kind[t] != kind[wanted]:
            continue
        nearest, closest = -1, math.inf
        for k in range(len(objects)):
            apart = math.hypot(objects[k, 0] - tracks[t, 0], objects[k, 1] - tracks[t, 1])
            if kind[k] == track_kind[t] and apart < closest:  # which NaN is not
                nearest, closest = k, apart
        if nearest == wanted and (closest < near_m or _touch(tracks[t], objects[wanted])):
            return True
    return False
