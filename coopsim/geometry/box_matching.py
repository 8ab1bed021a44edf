"""Matching of boxes one to one by GIoU, as `hungarian` does it, without comparing most of those that are apart.

Of boxes that are apart the GIoU is at most 0, and the hull of both, which it takes, is most of its cost. So a row whose
best likeness is above 0 has it with a near column, and is compared with all others only where another row contests that
column.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.assignment import extend_path, reassign, shift_potentials
from coopsim.geometry.iou import are_apart, corner_space, pair_overlap, turns_of
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit


class ScoredBoxes(NamedTuple):
    """N boxes to match.

    Attributes:
        boxes: (N, 7), contiguous.
        score: (N,)
        label: (N,) int; only boxes of one label are matched.
    """

    boxes: Floats
    score: Floats
    label: Ints


class Likeness(NamedTuple):
    """Similarity of two boxes: their GIoU, less what their scores differ by.

    Attributes:
        in_space: the GIoU is that in 3D; else in the BEV.
        score_weight: >= 0, loss per unit of difference of the scores.
    """

    in_space: bool = True
    score_weight: float = 0.0


@njit(cache=True, nogil=True)
def match_boxes(a: ScoredBoxes, b: ScoredBoxes, likeness: Likeness) -> tuple[Ints, Floats]:
    """Match N and M boxes of each label for as many pairs as possible, then for the largest sum of likeness.

    The result is that of `hungarian` for all pairs of a label.

    Returns:
        For each box of b the row (M,) of its box of a, -1 without one, and the likeness (M,) of both, -inf without one.
    """
    row_of, alike = np.full(len(b.boxes), -1), np.full(len(b.boxes), -np.inf)
    turns = turns_of(a.boxes), turns_of(b.boxes)
    order_a, order_b = np.argsort(a.label, kind="mergesort"), np.argsort(b.label, kind="mergesort")
    first, first_b = 0, 0
    while first < len(order_a) and first_b < len(order_b):
        label, label_b = a.label[order_a[first]], b.label[order_b[first_b]]
        last, last_b = first, first_b
        while label <= label_b and last < len(order_a) and a.label[order_a[last]] == label:
            last += 1
        while label_b <= label and last_b < len(order_b) and b.label[order_b[last_b]] == label_b:
            last_b += 1
        if label == label_b:
            _match_rows(a, order_a[first:last], b, order_b[first_b:last_b], turns, likeness, row_of, alike)
        first, first_b = last, last_b
    return row_of, alike


@njit(cache=True, nogil=True)
def _match_rows(
    a: ScoredBoxes,
    rows: Ints,
    b: ScoredBoxes,
    columns: Ints,
    turns: tuple[Floats, Floats],
    likeness: Likeness,
    row_of: Ints,
    alike: Floats,
) -> None:
    """Match the boxes of a at `rows` (n,) and of b at `columns` (m,) into `row_of` and `alike`.

    Shortest augmenting paths with potentials, as in `cheapest_assignment`, from the rows of the smaller side. They
    begin with the rows that have their best column to themselves.
    """
    swapped, space = len(rows) > len(columns), corner_space()
    few, many = (columns, rows) if swapped else (rows, columns)
    largest = _largest(a.score[rows], b.score[columns], likeness.score_weight)
    value, known = np.empty((len(few), len(many))), np.zeros(len(few), np.bool_)
    u, v = np.zeros(len(few) + 1), np.zeros(len(many) + 1)
    taken, way = np.zeros(len(many) + 1, np.int64), np.zeros(len(many) + 1, np.int64)
    waiting = np.zeros(len(few), np.bool_)
    for i in range(len(few)):
        best, column = 0.0, -1
        for j in range(len(many)):
            row, other = (many[j], few[i]) if swapped else (few[i], many[j])
            if not are_apart(a.boxes, turns[0], row, b.boxes, turns[1], other):
                value[i, j] = _likeness(a, row, b, other, turns, likeness, space)
                if value[i, j] > best:
                    best, column = value[i, j], j
        waiting[i] = column < 0 or taken[column + 1] > 0
        if not waiting[i]:
            taken[column + 1], u[i + 1] = i + 1, -best
    for i in range(len(few)):
        if not waiting[i]:
            continue
        taken[0], column = i + 1, 0
        shortest, done = np.full(len(many) + 1, np.inf), np.zeros(len(many) + 1, np.bool_)
        while taken[column] != 0:
            done[column] = True
            here = taken[column] - 1
            if not known[here]:
                known[here] = True
                for j in range(len(many)):
                    row, other = (many[j], few[here]) if swapped else (few[here], many[j])
                    value[here, j] = _likeness(a, row, b, other, turns, likeness, space)
                    if not np.isfinite(value[here, j]):  # costs more than all others can gain
                        value[here, j] = -3.0 * largest * (1 + len(few))
            step, following = extend_path(-value[here], u[here + 1], v, done, shortest, way, column)
            shift_potentials(step, taken, u, v, done, shortest)
            column = following
        reassign(column, taken, way)
    for j in range(len(many)):
        i = taken[j + 1] - 1
        if i >= 0 and value[i, j] >= -2.0 * largest:
            row, other = (many[j], few[i]) if swapped else (few[i], many[j])
            row_of[other], alike[other] = row, value[i, j]


@njit(cache=True, nogil=True)
def _likeness(
    a: ScoredBoxes,
    row: int,
    b: ScoredBoxes,
    other: int,
    turns: tuple[Floats, Floats],
    likeness: Likeness,
    space: Floats,
) -> float:
    in_3d, from_above = pair_overlap(a.boxes, turns[0], row, b.boxes, turns[1], other, True, space)
    value = in_3d if likeness.in_space else from_above
    if likeness.score_weight != 0:
        value -= likeness.score_weight * abs(a.score[row] - b.score[other])
    return value


@njit(cache=True, nogil=True)
def _largest(score: Floats, other: Floats, score_weight: float) -> float:
    """Return the largest size of a likeness of boxes with these scores (n,) and (m,)."""
    if score_weight == 0:
        return 1.0
    spread: float = max(score.max(), other.max()) - min(score.min(), other.min())
    return min(1.0 + score_weight * spread, 1e150)
