"""Places for the labels of markers, so that no label lies on another one or on a marker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats

_NEAR, _FAR = 6.0, 22.0
"""Distances of a label from its marker, where it is level with it, and where a line leads to it from above or below."""

_LINES, _CLOSE = 60, 14
"""Farthest that a label is moved up or down, in quarters of its height, at all and so as to keep off whiskers."""


def lay_out(points: Floats, sizes: Floats, taken: Floats, whiskers: Floats, bounds: Floats) -> Floats:
    """Place a label beside each point, the highest point first: to its right or left, as near as there is room.

    A label that would be far away lies on whiskers instead. Where there is no room at all, it is to the right of its
    point and may lie on other labels.

    Args:
        points: (N, 2) x and y of the markers in points of 1/72 inch, y upwards, as all that follows.
        sizes: (N, 2) width and height of the labels.
        taken: (M, 4) left, low, right, high of what must be kept free, as the markers.
        whiskers: (K, 4) alike, of what should be.
        bounds: (4,) left, low, right, high of the area.

    Returns:
        (N, 2) the left end and the middle of the height of each label.
    """
    placed = np.empty((len(points), 2))
    used = [*np.asarray(taken, dtype=np.float64).reshape(-1, 4)]
    avoided = [*np.asarray(whiskers, dtype=np.float64).reshape(-1, 4)]
    for k in sorted(range(len(points)), key=lambda each: (-points[each, 1], points[each, 0], each)):
        candidates = _candidates(points[k], sizes[k])
        close = 2 + 4 * (_CLOSE - 2)  # the level ones, and four for each step up and down
        clear = (each for each in candidates[:close] if _is_free(_box(each, sizes[k]), [*used, *avoided], bounds))
        free = (each for each in candidates if _is_free(_box(each, sizes[k]), used, bounds))
        placed[k] = next(clear, next(free, candidates[0]))
        used.append(_box(placed[k], sizes[k]))
    return placed


def _candidates(point: Floats, size: Floats) -> list[Floats]:
    """Return places for a label: level with its marker, then ever farther above and below, right before left."""
    width, height = size
    shifts = [sign * k * height / 4 for k in range(2, _LINES) for sign in (1, -1)]
    level = [(point[0] + _NEAR, point[1]), (point[0] - _NEAR - width, point[1])]
    moved = [(x, point[1] + shift) for shift in shifts for x in (point[0] + _FAR, point[0] - _FAR - width)]
    return [np.array(each) for each in (*level, *moved)]


def _box(place: Floats, size: Floats) -> Floats:
    return np.array([place[0], place[1] - size[1] / 2, place[0] + size[0], place[1] + size[1] / 2])


def _is_free(box: Floats, used: Sequence[Floats], bounds: Floats) -> bool:
    inside = box[0] >= bounds[0] and box[1] >= bounds[1] and box[2] <= bounds[2] and box[3] <= bounds[3]
    return bool(inside) and not any(_overlap(box, other) for other in used)


def _overlap(one: Floats, other: Floats) -> bool:
    return bool(one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3])
