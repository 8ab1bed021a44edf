"""The boxes of one object among the boxes of many agents: every two agents' boxes matched by 3D IoU, as kernels.

The result is that of `hungarian` on the IoU of all pairs, for every two agents. Boxes that do not overlap add nothing
to a matching, so only those that do are looked at, and a box with a single partner needs no solver.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.assignment import hungarian
from coopsim.geometry.iou import corner_room, overlap_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask

_MARGIN = 1e-9  # more than rounding


def match_agents(boxes: Floats, owner: Ints, label: Ints, threshold: float) -> tuple[Ints, Floats]:
    """Match the boxes of every two agents.

    Args:
        boxes: (N, 7).
        owner: (N,) number of each box's agent, from 0.
        label: (N,) classes; only boxes of a class match.
        threshold: smallest 3D IoU of a match, > 0.

    Returns:
        The pairs (K, 2) of rows, the lower agent's first, and their IoU (K,), in order of agents and rows.
    """
    pairs, value = _overlapping(boxes, owner, label)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], owner[pairs[:, 1]], owner[pairs[:, 0]]))
    pairs, value = pairs[order], value[order]
    stretch = _stretches(pairs, owner)
    certain, contested = _certain(pairs, value, stretch, len(boxes))
    open_rows = np.flatnonzero(contested)
    for rows in np.split(open_rows, np.flatnonzero(np.diff(stretch[open_rows])) + 1):
        certain[rows[_best(pairs[rows], value[rows])]] = True
    kept = certain & (value >= threshold)
    return pairs[kept], value[kept]


def _overlapping(boxes: Floats, owner: Ints, label: Ints) -> tuple[Ints, Floats]:
    """Return all pairs (K, 2) of overlapping boxes of a class and of two agents, and their IoU (K,)."""
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    order = np.argsort(boxes[:, 0], kind="stable")
    along = boxes[order, 0]
    # Rounding must not leave out what just touches.
    last = np.searchsorted(along, along + (reach[order] + reach.max(initial=0.0)) * (1 + 1e-9), side="right")
    pairs, value = _sweep(np.ascontiguousarray(boxes[order]), owner[order], label[order], order, last)
    return pairs, value


@njit(cache=True, nogil=True)
def _sweep(boxes: Floats, owner: Ints, label: Ints, row: Ints, last: Ints) -> tuple[Ints, Floats]:
    """Return `_overlapping` for boxes sorted along x; the partners of box k are among k + 1 to last[k] - 1."""
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    room = corner_room()
    pairs, value, count = np.empty((4 * len(boxes), 2), dtype=np.int64), np.empty(4 * len(boxes)), 0
    for k in range(len(boxes)):
        for n in range(k + 1, last[k]):
            dx, dy, both = boxes[n, 0] - boxes[k, 0], boxes[n, 1] - boxes[k, 1], reach[k] + reach[n]
            if owner[k] == owner[n] or label[k] != label[n] or dx * dx + dy * dy >= both * both:
                continue
            i, j = (k, n) if owner[k] < owner[n] else (n, k)
            overlap = overlap_3d(boxes[i], boxes[j], (cos[i], sin[i], cos[j], sin[j]), room)
            if overlap > 0:
                if count == len(value):
                    pairs, value = _twice_as_long(pairs, value)
                pairs[count, 0], pairs[count, 1], value[count] = row[i], row[j], overlap
                count += 1
    return pairs[:count].copy(), value[:count].copy()


@njit(cache=True, nogil=True)
def _twice_as_long(pairs: Ints, value: Floats) -> tuple[Ints, Floats]:
    more_pairs, more_value = np.empty((2 * len(pairs), 2), dtype=np.int64), np.empty(2 * len(value))
    more_pairs[: len(pairs)], more_value[: len(value)] = pairs, value
    return more_pairs, more_value


@njit(cache=True, nogil=True)
def _stretches(pairs: Ints, owner: Ints) -> Ints:
    """Return the number (K,) of each pair's stretch: of the same two agents."""
    stretch = np.zeros(len(pairs), dtype=np.int64)
    for k in range(1, len(pairs)):
        same = owner[pairs[k, 0]] == owner[pairs[k - 1, 0]] and owner[pairs[k, 1]] == owner[pairs[k - 1, 1]]
        stretch[k] = stretch[k - 1] + (0 if same else 1)
    return stretch


@njit(cache=True, nogil=True)
def _certain(pairs: Ints, value: Floats, stretch: Ints, count: int) -> tuple[Mask, Mask]:
    """Return which pairs (K,) are in the best matching of their two agents for certain, and which may be.

    A pair is for certain if it is worth more than the next best pair of its one box and of its other together.
    """
    certain, contested = np.zeros(len(pairs), dtype=np.bool_), np.zeros(len(pairs), dtype=np.bool_)
    best, rival = np.zeros(count), np.zeros(count)
    taken = np.zeros(count, dtype=np.bool_)
    first = 0
    while first < len(pairs):
        end = first
        while end < len(pairs) and stretch[end] == stretch[first]:
            for box in pairs[end]:
                best[box], rival[box], taken[box] = 0.0, 0.0, False
            end += 1
        for k in range(first, end):
            for box in pairs[k]:
                if value[k] > best[box]:
                    best[box], rival[box] = value[k], best[box]
                elif value[k] > rival[box]:
                    rival[box] = value[k]
        for k in range(first, end):
            one, other = pairs[k]
            if value[k] == best[one] == best[other] and value[k] > rival[one] + rival[other] + _MARGIN:
                certain[k] = taken[one] = taken[other] = True
        for k in range(first, end):
            contested[k] = not (taken[pairs[k, 0]] or taken[pairs[k, 1]])
        first = end
    return certain, contested


def _best(pairs: Ints, value: Floats) -> Ints:
    """Return which of two agents' pairs (K, 2) are in the matching with the largest sum of values (K,)."""
    one, row = np.unique(pairs[:, 0], return_inverse=True)
    other, column = np.unique(pairs[:, 1], return_inverse=True)
    affinity, number = np.zeros((len(one), len(other))), np.full((len(one), len(other)), -1)
    affinity[row, column], number[row, column] = value, np.arange(len(value))
    chosen = number[hungarian(affinity, 0.0)]
    return chosen[chosen >= 0]
