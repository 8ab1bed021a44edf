"""Boxes of one object among the boxes of many agents: greedy suppression of near pairs alone, as kernels."""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.geometry.iou import bev_overlap
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

_CORNERS = 16  # room for the corners of a clipped rectangle, and for what rounding may add


def owners(boxes: Floats, label: Ints, iou_threshold: float) -> Ints:
    """Return for each box the row (N,) of the box that stands for it: itself, or the kept rival that it overlaps most.

    From best to worst, a box is kept unless it overlaps a better kept one. Only kept boxes are compared with others,
    and only with those whose footprints can touch theirs: the cost is about that of the boxes around each object.

    Args:
        boxes: (N, 7), finite, best first.
        label: (N,) classes; only boxes of a class are rivals.
        iou_threshold: least BEV IoU of rivals.
    """
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    order = np.argsort(boxes[:, 0], kind="stable")
    along = boxes[order, 0]
    window = (reach + reach.max(initial=0.0)) * (1 + 1e-9)  # rounding must not leave out what just touches
    first = np.searchsorted(along, boxes[:, 0] - window)
    last = np.searchsorted(along, boxes[:, 0] + window, side="right")
    owner: Ints = _owners(np.ascontiguousarray(boxes), np.ascontiguousarray(label), order, first, last, iou_threshold)
    return owner


@njit(cache=True, nogil=True)
def _owners(boxes: Floats, label: Ints, order: Ints, first: Ints, last: Ints, iou_threshold: float) -> Ints:
    """Return `owners`; the rivals of a box are among `order[first:last]` of its row."""
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    polygon, spare = np.empty((_CORNERS, 2)), np.empty((_CORNERS, 2))
    owner, most = np.full(len(boxes), -1), np.zeros(len(boxes))
    suppressed = np.zeros(len(boxes), dtype=np.bool_)
    for row in range(len(boxes)):
        if suppressed[row]:
            continue
        for place in range(first[row], last[row]):
            other = order[place]
            dx, dy, both = boxes[other, 0] - boxes[row, 0], boxes[other, 1] - boxes[row, 1], reach[row] + reach[other]
            if other == row or label[other] != label[row] or dx * dx + dy * dy >= both * both:
                continue
            angles = (cos[row], sin[row], cos[other], sin[other])
            overlap = bev_overlap(boxes[row], boxes[other], angles, polygon, spare)
            if overlap >= iou_threshold:
                suppressed[other] |= other > row
                if overlap > most[other]:
                    owner[other], most[other] = row, overlap
    for row in range(len(boxes)):
        if not suppressed[row]:
            owner[row] = row  # though it may overlap a worse kept box by rounding, or not even itself without an area
    return owner


@njit(cache=True, nogil=True)
def weighted_means(values: Floats, weight: Floats, group: Ints, count: int) -> Floats:
    """Return the weighted means (count, D) of values (N, D) by group (N,); a group without a row has zeros."""
    total, mean = np.zeros(count), np.zeros((count, values.shape[1]))
    for row in range(len(values)):
        total[group[row]] += weight[row]
    for row in range(len(values)):
        share = weight[row] / total[group[row]]
        for column in range(values.shape[1]):
            mean[group[row], column] += share * values[row, column]
    return mean


@njit(cache=True, nogil=True)
def seen_by_any(seen_by: Mask, group: Ints, count: int) -> Mask:
    """Return which agents (count, A) saw a row of each group, of rows (N, A) by group (N,)."""
    seen = np.zeros((count, seen_by.shape[1]), dtype=np.bool_)
    for row in range(len(seen_by)):
        for agent in range(seen_by.shape[1]):
            seen[group[row], agent] |= seen_by[row, agent]
    return seen
