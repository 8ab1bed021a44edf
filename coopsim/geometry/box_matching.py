"""Matching of boxes one to one by GIoU, as `hungarian` matches them, without comparing most of those that are apart.

Of boxes that are apart the GIoU is at most 0, and the hull of both, which it takes, is most of its cost. So a row whose
best overlap is above 0 is known by its near columns alone, and is compared with all others only where another row
contests its column.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.assignment import extend_path, reassign, shift_potentials
from coopsim.geometry.iou import are_apart, corner_space, pair_overlap, turns_of
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit


@njit(cache=True, nogil=True)
def match_boxes(a: Floats, a_class: Ints, b: Floats, b_class: Ints, in_space: bool) -> tuple[Ints, Floats]:
    """Match boxes (N, 7) and (M, 7) of each class for as many pairs as possible, then for the largest sum of GIoU.

    The GIoU is that in 3D if `in_space`, else that in the BEV. The result is that of `hungarian` for all pairs of a
    class. The arrays are contiguous.

    Returns:
        For each box of b the row (M,) of its box of a, -1 without one, and the GIoU (M,) of both, -inf without one.
    """
    row_of, giou = np.full(len(b), -1), np.full(len(b), -np.inf)
    turns_a, turns_b, space = turns_of(a), turns_of(b), corner_space()
    order_a, order_b = np.argsort(a_class, kind="mergesort"), np.argsort(b_class, kind="mergesort")
    first, first_b = 0, 0
    while first < len(a) and first_b < len(b):
        label, label_b = a_class[order_a[first]], b_class[order_b[first_b]]
        last, last_b = first, first_b
        while label <= label_b and last < len(a) and a_class[order_a[last]] == label:
            last += 1
        while label_b <= label and last_b < len(b) and b_class[order_b[last_b]] == label_b:
            last_b += 1
        if label == label_b:
            rows, columns = order_a[first:last], order_b[first_b:last_b]
            _match_class(a, turns_a, rows, b, turns_b, columns, in_space, space, row_of, giou)
        first, first_b = last, last_b
    return row_of, giou


@njit(cache=True, nogil=True)
def _match_class(
    a: Floats,
    turns_a: Floats,
    rows: Ints,
    b: Floats,
    turns_b: Floats,
    columns: Ints,
    in_space: bool,
    space: Floats,
    row_of: Ints,
    giou: Floats,
) -> None:
    """Match the boxes of a at `rows` (n,) and of b at `columns` (m,), all of one class, into `row_of` and `giou`.

    Shortest augmenting paths with potentials, as in `cheapest_assignment`, from the rows of the smaller side. They
    begin with the rows that have their best column to themselves.
    """
    swapped = len(rows) > len(columns)
    few, many = (columns, rows) if swapped else (rows, columns)
    value, known = np.empty((len(few), len(many))), np.zeros(len(few), np.bool_)
    u, v = np.zeros(len(few) + 1), np.zeros(len(many) + 1)
    taken, way = np.zeros(len(many) + 1, np.int64), np.zeros(len(many) + 1, np.int64)
    waiting = np.zeros(len(few), np.bool_)
    for i in range(len(few)):
        best, column = 0.0, -1
        for j in range(len(many)):
            row, other = (many[j], few[i]) if swapped else (few[i], many[j])
            if not are_apart(a, turns_a, row, b, turns_b, other):
                in_3d, from_above = pair_overlap(a, turns_a, row, b, turns_b, other, True, space)
                value[i, j] = in_3d if in_space else from_above
                if value[i, j] > best:
                    best, column = value[i, j], j
        waiting[i] = column < 0 or taken[column + 1] > 0
        if not waiting[i]:
            taken[column + 1], u[i + 1] = i + 1, -best
    for i in np.flatnonzero(waiting):
        taken[0], column = i + 1, 0
        shortest, done = np.full(len(many) + 1, np.inf), np.zeros(len(many) + 1, np.bool_)
        while taken[column] != 0:
            done[column] = True
            here = taken[column] - 1
            if not known[here]:
                known[here] = True
                for j in range(len(many)):
                    row, other = (many[j], few[here]) if swapped else (few[here], many[j])
                    in_3d, from_above = pair_overlap(a, turns_a, row, b, turns_b, other, True, space)
                    value[here, j] = in_3d if in_space else from_above
                    if not np.isfinite(value[here, j]):  # costs more than all others can gain
                        value[here, j] = -_IMPOSSIBLE * (1 + len(few))
            step, following = extend_path(-value[here], u[here + 1], v, done, shortest, way, column)
            shift_potentials(step, taken, u, v, done, shortest)
            column = following
        reassign(column, taken, way)
    for j in range(len(many)):
        i = taken[j + 1] - 1
        if i >= 0 and value[i, j] >= -1.0:
            row, other = (many[j], few[i]) if swapped else (few[i], many[j])
            row_of[other], giou[other] = row, value[i, j]


_IMPOSSIBLE = 3.0
"""Cost of a pair without a GIoU, by the number of rows."""
