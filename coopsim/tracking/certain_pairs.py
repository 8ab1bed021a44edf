"""Hungarian matching of tracks and detections without the affinities of all pairs, and with the same result.

Most tracks have one detection near them, which has no other track near it. Such a pair is in the optimal matching
whatever the affinities of pairs far apart may be. Only what is left over is compared pair by pair.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity import RowAffinity
from coopsim.types import Ints

_MARGIN = 1e-9  # more than rounding


def hungarian_by_rows(affinity: RowAffinity, first: Floats, second: Floats, classes: Pairs, gate: float) -> Pairs:
    """Return what `hungarian` gives for the affinity of pairs of one class, -inf for all others.

    Args:
        affinity: compares the rows.
        first: (N, k) rows of tracks.
        second: (M, k) rows of detections.
        classes: of the tracks (N,), and of the detections (M,).
        gate: smallest affinity of a pair.
    """
    clipping = affinity.clipping
    if clipping is None:
        return hungarian(of_one_class(affinity.kernel(first, second), *classes), gate)
    clipped = clipping.kernel(first, second, clipping.floor)
    rows, columns, left, right = _certain_pairs(clipped, *classes, clipping.floor, clipping.lowest, gate)
    if not len(left):
        return rows, columns
    exact = of_one_class(affinity.kernel(first[left], second[right]), classes[0][left], classes[1][right])
    row, column = hungarian(exact, gate)
    rows, columns = np.concatenate([rows, left[row]]), np.concatenate([columns, right[column]])
    order = np.argsort(rows)
    return rows[order], columns[order]


def of_one_class(affinity: Floats, first: Ints, second: Ints) -> Floats:
    """Return the affinity (N, M) with -inf for the pairs whose classes, (N,) and (M,), differ."""
    return np.where(first[:, None] == second, affinity, -np.inf)


@njit(cache=True, nogil=True)
def _certain_pairs(
    clipped: Floats, first: Ints, second: Ints, floor: float, lowest: float, gate: float
) -> tuple[Ints, Ints, Ints, Ints]:
    """Find the pairs that are in every optimal matching.

    A pair (i, j) is, if its affinity is larger than any other in its row, r, and in its column, c, and if together with
    the lowest of all affinities it is more than r + c. For a matching that had (i, m) and (n, j) instead would gain by
    the exchange for (i, j) and (n, m), whatever (n, m) is worth.

    Returns:
        The certain pairs from the gate on, rows (K,) in order and columns (K,); and the other rows and columns, none
        if no pair of them reaches the gate.
    """
    certain = np.full(len(first), -1)
    free = np.ones(len(second), dtype=np.bool_)
    row_next, row_at, column_next, column_at = _two_best(clipped, first, second, floor)
    for i in range(len(first)):
        j = row_at[i]
        if j < 0 or column_at[j] != i:
            continue
        rival = max(row_next[i], column_next[j], row_next[i] + column_next[j] - lowest)
        if clipped[i, j] > rival + _MARGIN:
            certain[i], free[j] = j, False
    left, right = np.flatnonzero(certain < 0), np.flatnonzero(free)
    if gate > floor and not _any_from(clipped, first, second, left, right, gate):
        left, right = left[:0], right[:0]
    rows = np.flatnonzero(certain >= 0)
    columns = certain[rows]
    kept = np.array([clipped[i, certain[i]] >= gate for i in rows], dtype=np.bool_)
    return rows[kept], columns[kept], left, right


@njit(cache=True, nogil=True)
def _two_best(affinity: Floats, first: Ints, second: Ints, floor: float) -> tuple[Floats, Ints, Floats, Ints]:
    """Return the second best value of each row, at least the floor, and the column of the best one; so of each column.

    The column is -1 where no value is above the floor; everywhere, if a value is not a number: then an exchange may be
    impossible.
    """
    rows, columns = affinity.shape
    row_best, row_next, row_at = np.full(rows, floor), np.full(rows, floor), np.full(rows, -1)
    column_best, column_next, column_at = np.full(columns, floor), np.full(columns, floor), np.full(columns, -1)
    for i in range(rows):
        for j in range(columns):
            value = affinity[i, j]
            if value <= floor or first[i] != second[j]:
                continue
            if np.isnan(value):
                return row_next, np.full(rows, -1), column_next, np.full(columns, -1)
            if value > row_best[i]:
                row_next[i], row_best[i], row_at[i] = row_best[i], value, j
            elif value > row_next[i]:
                row_next[i] = value
            if value > column_best[j]:
                column_next[j], column_best[j], column_at[j] = column_best[j], value, i
            elif value > column_next[j]:
                column_next[j] = value
    return row_next, row_at, column_next, column_at


@njit(cache=True, nogil=True)
def _any_from(affinity: Floats, first: Ints, second: Ints, rows: Ints, columns: Ints, gate: float) -> bool:
    """Return whether any pair of these rows and columns reaches the gate."""
    for i in rows:
        for j in columns:
            if first[i] == second[j] and affinity[i, j] >= gate:
                return True
    return False
