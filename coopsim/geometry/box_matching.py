"""Matching of two sets of boxes, class by class, for the largest sum of BEV GIoU (Hungarian).

The result is that of `hungarian` on all pairs of a class, but hardly any GIoU is computed. The shortest augmenting path
(Crouse, "On implementing 2D rectangular assignment algorithms", 2016) asks for a pair's value only where the pair might
be on it, and two boxes some metres apart can be told to be a bad pair by their distance: the hull of both contains half
of each box and a trapezoid between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import corner_room, giou_bev_of_pair
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, Mask
from coopsim.support.kernels import njit

_SLACK = 1e-9
"""What a bound is lowered by, for rounding."""

_IMPOSSIBLE = 3.0
"""Cost of a pair without a GIoU, times one more than the number of pairs: more than all others can gain."""


def match_boxes(own: Boxes3D, own_label: Ints, other: Boxes3D, other_label: Ints, gate: float) -> tuple[Ints, Ints]:
    """Return the rows (K,) and (K,) of boxes of one class that lie on one object (Hungarian on the BEV GIoU).

    Args:
        own: N boxes.
        own_label: (N,) their classes.
        other: M boxes, in the same frame.
        other_label: (M,) their classes.
        gate: smallest BEV GIoU of two boxes on one object, in [-1, 1].
    """
    own_row, giou = match_rows(footprints(own.array), own_label, footprints(other.array), other_label)
    columns = np.flatnonzero(giou >= gate)
    order = np.argsort(own_row[columns])
    return own_row[columns][order], columns[order]


@njit(cache=True, nogil=True)
def footprints(boxes: Floats) -> Floats:
    """Return what boxes (N, 7) are from above, (N, 6): x, y, length, width m, cosine and sine of the heading."""
    out = np.empty((len(boxes), 6))
    for k in range(len(boxes)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = boxes[k, 0], boxes[k, 1], boxes[k, 3], boxes[k, 4]
        out[k, 4], out[k, 5] = np.cos(boxes[k, 6]), np.sin(boxes[k, 6])
    return out


@njit(cache=True, nogil=True)
def match_rows(own: Floats, own_label: Ints, other: Floats, other_label: Ints) -> tuple[Ints, Floats]:
    """Match each class for as many pairs as possible, then for the largest sum of BEV GIoU.

    Args:
        own: (N, 6) `footprints`.
        own_label: (N,) their classes.
        other: (M, 6) `footprints`, in the same frame.
        other_label: (M,) their classes.

    Returns:
        For each other box the row (M,) of its own box, -1 without one, and the BEV GIoU (M,) of both, -inf without one.
    """
    own_row, giou = np.full(len(other), -1), np.full(len(other), -np.inf)
    done = np.zeros(len(other), dtype=np.bool_)
    for first in range(len(other)):
        if done[first]:
            continue
        mine, theirs = rows_of_class(own_label, other_label[first]), rows_of_class(other_label, other_label[first])
        done[theirs] = True
        if len(mine) <= len(theirs):  # each of the fewer boxes gets a pair
            column_of, cost = _match_class(own[mine], other[theirs], True)
            for k in range(len(mine)):
                own_row[theirs[column_of[k]]], giou[theirs[column_of[k]]] = mine[k], -cost[k]
        else:
            column_of, cost = _match_class(other[theirs], own[mine], False)
            for k in range(len(theirs)):
                own_row[theirs[k]], giou[theirs[k]] = mine[column_of[k]], -cost[k]
    impossible = giou < -2
    own_row[impossible], giou[impossible] = -1, -np.inf
    return own_row, giou


@njit(cache=True, nogil=True)
def rows_of_class(labels: Ints, label: int) -> Ints:
    """Return the rows with a label."""
    rows, count = np.empty(len(labels), dtype=np.int64), 0
    for k in range(len(labels)):
        if labels[k] == label:
            rows[count] = k
            count += 1
    return rows[:count]


class _Search(NamedTuple):
    """A matching of R rows to C columns that grows by one row after another.

    Attributes:
        rows: (R, 6) `footprints`, R <= C.
        columns: (C, 6) `footprints`.
        own_rows: whether the own boxes are the rows.
        room: from `corner_room`.
        cost: (R, C) negative GIoU; of a pair that is not known a lower bound.
        known: (R, C) whether the cost is exact.
        u: (R,) dual variables of the rows.
        v: (C,) dual variables of the columns.
        column_of: (R,) the column of each row, -1 without one.
        row_of: (C,) the row of each column, -1 without one.
        before: (C,) the row before each column on the shortest path.
        shortest: (C,) length of that path.
        left: (C,) the columns: first those that are not reached yet, then those that are.
    """

    rows: Floats
    columns: Floats
    own_rows: bool
    room: Floats
    cost: Floats
    known: Mask
    u: Floats
    v: Floats
    column_of: Ints
    row_of: Ints
    before: Ints
    shortest: Floats
    left: Ints


@njit(cache=True, nogil=True)
def _match_class(rows: Floats, columns: Floats, own_rows: bool) -> tuple[Ints, Floats]:
    """Return the column (R,) of each row, R <= C, in the matching with the least sum of costs, and the costs (R,)."""
    few, many = len(rows), len(columns)
    none = np.full(few + 2 * many, -1)
    column_of, row_of, before = none[:few], none[few : few + many], none[few + many :]
    cost, known = _least_costs(rows, columns), np.zeros((few, many), dtype=np.bool_)
    u, v, shortest, left = np.zeros(few), np.zeros(many), np.empty(many), np.empty(many, dtype=np.int64)
    search = _Search(
        rows, columns, own_rows, corner_room(), cost, known, u, v, column_of, row_of, before, shortest, left
    )
    for row in range(few):
        if not _add_to_nearest(search, row):
            _add(search, row)
    paid = np.empty(few)
    for row in range(few):
        paid[row] = cost[row, column_of[row]]
    return column_of, paid


@njit(cache=True, nogil=True, error_model="numpy")
def _least_costs(rows: Floats, columns: Floats) -> Floats:
    """Return a lower bound of each pair's cost (R, C).

    The line through both centres cuts no chord across a box that is shorter than the box's shorter side.
    """
    least = np.empty((len(rows), len(columns)))
    for i in range(len(rows)):
        x, y, length, width = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]
        area, chord = length * width, min(length, width)
        for j in range(len(columns)):
            dx, dy, its_length, its_width = columns[j, 0] - x, columns[j, 1] - y, columns[j, 2], columns[j, 3]
            away = np.sqrt(dx * dx + dy * dy)
            least[i, j] = -1.0 - _SLACK
            if 2 * away > length + width + its_length + its_width:  # they cannot touch
                areas = area + its_length * its_width
                least[i, j] = 1.0 - _SLACK - 2 * areas / (areas + away * (chord + min(its_length, its_width)))
    return least


@njit(cache=True, nogil=True)
def _add_to_nearest(search: _Search, row: int) -> bool:
    """Match a row to its best column, if that is free and may touch the row's box; else return False."""
    cost, v = search.cost[row], search.v
    best, at, least = np.inf, -1, np.inf
    for column in range(len(cost)):
        if cost[column] > -1.0:
            least = min(least, cost[column])
            continue
        _learn(search, row, column)
        far = cost[column] - v[column]
        if far < best:
            best, at = far, column
    # No dual variable of a column is positive, so no other column can be nearer.
    if at < 0 or best >= least or search.row_of[at] >= 0:
        return False
    search.u[row], search.column_of[row], search.row_of[at] = best, at, row
    return True


@njit(cache=True, nogil=True)
def _add(search: _Search, new: int) -> None:
    """Match one more row, along the shortest path from it to a free column."""
    left, shortest, row_of = search.left, search.shortest, search.row_of
    count = len(left)
    for k in range(count):
        shortest[k] = np.inf
        left[k] = count - 1 - k  # in reverse, so that the identity solves constant costs
    row, length, nearest = new, 0.0, np.inf
    while True:
        nearest = _reach(search, row, length, nearest, count)
        at = _closest(left, shortest, row_of, count)
        column = left[at]
        length = shortest[column]
        count -= 1
        left[at], left[count] = left[count], column
        if row_of[column] < 0:
            break
        row = row_of[column]
    _augment(search, new, column, count)


@njit(cache=True, nogil=True)
def _reach(search: _Search, row: int, length: float, nearest: float, count: int) -> float:
    """Find shorter paths to columns by way of a row.

    Args:
        search: the matching; of its columns the first `count` are left.
        row: the row.
        length: length of the path to it.
        nearest: length of the shortest path to a free column so far. Columns farther away do not matter.
        count: number of columns.

    Returns:
        The new `nearest`.
    """
    cost, known, shortest, left = search.cost[row], search.known[row], search.shortest, search.left
    v, row_of, before, offset = search.v, search.row_of, search.before, search.u[row]
    likeliest, least = -1, nearest
    for k in range(count):
        column = left[k]
        far = length + cost[column] - offset - v[column]
        if row_of[column] < 0 and far < least:
            likeliest, least = column, far
    if likeliest >= 0:  # its exact cost first, because that spares most of the others
        if not known[likeliest]:
            _learn(search, row, likeliest)
        nearest = min(nearest, length + cost[likeliest] - offset - v[likeliest])
    for k in range(count):
        column = left[k]
        far = length + cost[column] - offset - v[column]
        if far >= shortest[column] or far > nearest:
            continue
        if not known[column]:
            _learn(search, row, column)
            far = length + cost[column] - offset - v[column]
        if far < shortest[column]:
            before[column], shortest[column] = row, far
            if row_of[column] < 0:
                nearest = min(nearest, far)
    return nearest


@njit(cache=True, nogil=True)
def _learn(search: _Search, row: int, column: int) -> None:
    """Compute the cost of a pair."""
    a, b = search.rows[row], search.columns[column]
    if not search.own_rows:
        a, b = b, a
    one, other = (a[0], a[1], a[2], a[3], a[4], a[5]), (b[0], b[1], b[2], b[3], b[4], b[5])
    cost = -giou_bev_of_pair(one, other, search.room)
    search.cost[row, column] = cost if np.isfinite(cost) else _IMPOSSIBLE * (1 + len(search.rows))
    search.known[row, column] = True


@njit(cache=True, nogil=True)
def _closest(left: Ints, shortest: Floats, row_of: Ints, count: int) -> int:
    """Return the place of the closest column in `left`; of equal ones a free one, which ends the path."""
    at, lowest = 0, np.inf
    for k in range(count):
        far = shortest[left[k]]
        if far < lowest or (far == lowest and row_of[left[k]] < 0):
            at, lowest = k, far
    return at


@njit(cache=True, nogil=True)
def _augment(search: _Search, new: int, end: int, count: int) -> None:
    """Swap the pairs along the path from the row `new` to the column `end`, and update the dual variables."""
    left, shortest, u, v = search.left, search.shortest, search.u, search.v
    row_of, column_of, before = search.row_of, search.column_of, search.before
    u[new] += shortest[end]
    for k in range(count, len(left)):
        column = left[k]
        spared = shortest[end] - shortest[column]
        v[column] -= spared
        if row_of[column] >= 0:
            u[row_of[column]] += spared
    column = end
    while column >= 0:
        row = before[column]
        row_of[column] = row
        column_of[row], column = column, column_of[row]
