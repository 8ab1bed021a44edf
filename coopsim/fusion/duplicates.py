"""Boxes of one object among the boxes of many agents: greedy suppression of near pairs alone, as kernels."""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.geometry.iou import bev_overlap, corner_room
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask


def suppress(boxes: Floats, score: Floats, label: Ints, iou_threshold: float) -> tuple[Ints, Ints, Ints]:
    """Suppress boxes of a class that overlap a better one, greedily.

    From best to worst, a box is kept unless it overlaps a better kept one. Only kept boxes are compared with others,
    and only with those whose footprints can touch theirs: the cost is about that of the boxes around each object.

    Args:
        boxes: (N, 7).
        score: (N,)
        label: (N,) classes; only boxes of a class are rivals.
        iou_threshold: least BEV IoU of rivals.

    Returns:
        The order (N,) from best to worst; the rows (K,) of the kept boxes in that order; and for each row (N,) the
        number in 0..K - 1 of the kept box that stands for it, the rival that it overlaps most, or -1 if it or its score
        is not finite.
    """
    order, along = np.argsort(-score, kind="stable"), np.argsort(boxes[:, 0], kind="stable")
    # Contiguous, so that the kernel is compiled once.
    score, label = np.ascontiguousarray(score), np.ascontiguousarray(label)
    kept, number = _suppress(boxes, score, label, order, along, iou_threshold)
    return order, kept, number


@njit(cache=True, nogil=True)
def _suppress(
    boxes: Floats, score: Floats, label: Ints, order: Ints, along: Ints, iou_threshold: float
) -> tuple[Ints, Ints]:
    """Return the kept rows and the numbers of `suppress`; `along` are the rows in order of their x."""
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    room = corner_room()
    place, free = np.empty(len(boxes), dtype=np.int64), np.empty(len(boxes), dtype=np.bool_)
    widest = 0.0
    for at in range(len(along)):
        row = along[at]
        place[row], free[row] = at, np.isfinite(boxes[row]).all() and np.isfinite(score[row])
        if free[row]:
            widest = max(widest, reach[row])
    candidate = free.copy()
    kept, number, most = np.empty(len(boxes), dtype=np.int64), np.full(len(boxes), -1), np.zeros(len(boxes))
    count = 0
    for row in order:
        if not free[row]:
            continue
        free[row], candidate[row], number[row] = False, False, count
        window = (reach[row] + widest) * (1 + 1e-9)  # rounding must not leave out what just touches
        for step in (-1, 1):
            at = place[row] + step
            while 0 <= at < len(along) and not abs(boxes[along[at], 0] - boxes[row, 0]) > window:
                other = along[at]
                at += step
                if not candidate[other] or label[other] != label[row]:
                    continue
                dx, dy, both = (
                    boxes[other, 0] - boxes[row, 0],
                    boxes[other, 1] - boxes[row, 1],
                    reach[row] + reach[other],
                )
                if dx * dx + dy * dy >= both * both:
                    continue
                angles = (cos[row], sin[row], cos[other], sin[other])
                overlap = bev_overlap(boxes[row], boxes[other], angles, room)
                if overlap >= iou_threshold and overlap > most[other]:
                    free[other], number[other], most[other] = False, count, overlap
        kept[count] = row
        count += 1
    return kept[:count], number


@njit(cache=True, nogil=True)
def weighted_means(boxes: Floats, weight: Floats, order: Ints, number: Ints, count: int) -> Floats:
    """Return the weighted mean centre and size (count, 6) of boxes (N, 7) by number (N,), summed in an order (N,)."""
    total, mean = np.zeros(count), np.zeros((count, 6))
    for row in order:
        if number[row] >= 0:
            total[number[row]] += weight[row]
    for row in order:
        if number[row] >= 0:
            share = weight[row] / total[number[row]]
            for column in range(6):
                mean[number[row], column] += share * boxes[row, column]
    return mean


@njit(cache=True, nogil=True)
def seen_by_any(seen_by: Mask, number: Ints, count: int) -> Mask:
    """Return which agents (count, A) saw a row of each number, of rows (N, A) by number (N,); -1 is left out."""
    seen = np.zeros((count, seen_by.shape[1]), dtype=np.bool_)
    for row in range(len(seen_by)):
        if number[row] >= 0:
            for agent in range(seen_by.shape[1]):
                seen[number[row], agent] |= seen_by[row, agent]
    return seen
