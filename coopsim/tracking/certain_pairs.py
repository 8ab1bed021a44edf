"""Hungarian matching of tracks and detections without the affinities of all pairs, and with the same result.

Most tracks have one detection near them, which has no other track near it. Such a pair is in the optimal matching
whatever the affinities of pairs far apart may be. Only what is left over is compared pair by pair.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.tracking.affinity import BoxAffinity
from coopsim.types import Ints, Mask

_MARGIN = 1e-9  # more than rounding


def hungarian_by_rows(affinity: BoxAffinity, first: Floats, second: Floats, classes: Pairs, gate: float) -> Pairs:
    """Return what `hungarian` gives for the affinity of pairs of one class, -inf for all others.

    Args:
        affinity: compares the rows.
        first: (N, 8) rows of tracks.
        second: (M, 8) rows of detections.
        classes: of the tracks (N,), and of the detections (M,).
        gate: smallest affinity of a pair.
    """
    clipping = affinity.clipping
    # A filter may shrink a track through zero, and then bounds on overlaps hold no more.
    solid = min(first[:, 3:6].min(initial=1.0), second[:, 3:6].min(initial=1.0)) > 0
    if clipping is None or not solid:
        return hungarian(of_one_class(affinity.compare(first, second), *classes), gate)
    clipped = clipping.kernel(first[:, :7], second[:, :7], clipping.floor)
    score, weight = (first[:, 7].copy(), second[:, 7].copy()), affinity.score_weight
    rows, columns, left, right = _certain_pairs(
        clipped, classes, score, weight, (clipping.floor, clipping.lowest, gate)
    )
    if not len(left):
        return rows, columns
    exact = of_one_class(affinity.compare(first[left], second[right]), classes[0][left], classes[1][right])
    row, column = hungarian(exact, gate)
    rows, columns = np.concatenate([rows, left[row]]), np.concatenate([columns, right[column]])
    order = np.argsort(rows)
    return rows[order], columns[order]


def of_one_class(affinity: Floats, first: Ints, second: Ints) -> Floats:
    """Return the affinity (N, M) with -inf for the pairs whose classes, (N,) and (M,), differ."""
    return np.where(first[:, None] == second, affinity, -np.inf)


@njit(cache=True, nogil=True)
def _certain_pairs(
    clipped: Floats,
    classes: Pairs,
    score: tuple[Floats, Floats],
    weight: float,
    limits: tuple[float, float, float],
) -> tuple[Ints, Ints, Ints, Ints]:
    """Find the pairs that are in every optimal matching.

    Be v the values of boxes and d the differences of scores; the affinity is v - w d. A pair (i, j) is certain if v is
    larger than all others in its row and in its column, at most r and c, and if

        v - 2 w d > r + c - the lowest of all values, and v - w d > r and c.

    For where a matching had (i, m) and (n, j) instead, the exchange for (i, j) and (n, m) gains, whatever v of (n, m)
    is: its scores differ by at most those of (i, m), (i, j) and (n, j) together.

    Args:
        clipped: (N, M) values v.
        classes: (N,) and (M,); others do not match.
        score: (N,) and (M,).
        weight: w.
        limits: value to which smaller ones are clipped, lowest value, and the gate.

    Returns:
        The certain pairs from the gate on, rows (K,) in order and columns (K,); and the other rows and columns, none
        if no pair of them reaches the gate.
    """
    floor, lowest, gate = limits
    certain, free = np.full(len(clipped), -1), np.ones(clipped.shape[1], dtype=np.bool_)
    found = True
    while found:  # without the certain pairs, others have no rival any more
        found = False
        row_next, row_at, column_next, column_at = _two_best(clipped, classes, floor, certain, free)
        for i in range(len(certain)):
            j = row_at[i]
            if j < 0 or column_at[j] != i:
                continue
            unlike = weight * abs(score[0][i] - score[1][j])
            affinity, rival = clipped[i, j] - unlike, max(row_next[i], column_next[j])
            if affinity > rival + _MARGIN and affinity - unlike > row_next[i] + column_next[j] - lowest + _MARGIN:
                certain[i], free[j], found = j, False, True
                clipped[i, j] = affinity
    rows = np.flatnonzero(certain >= 0)
    columns = certain[rows]
    kept = np.array([clipped[i, certain[i]] >= gate for i in rows], dtype=np.bool_)
    left, right = np.flatnonzero(certain < 0), np.flatnonzero(free)
    if gate > floor and not _any_from(clipped, classes, score, weight, left, right, gate):
        left, right = left[:0], right[:0]
    return rows[kept], columns[kept], left, right


@njit(cache=True, nogil=True)
def _two_best(
    affinity: Floats, classes: Pairs, floor: float, certain: Ints, free: Mask
) -> tuple[Floats, Ints, Floats, Ints]:
    """Return the second best value of each row, at least the floor, and the column of the best one; so of each column.

    Rows with a certain pair and columns that are not free are left out. The column is -1 where no value is above the
    floor; everywhere, if a value is not a number: then an exchange may be impossible.
    """
    rows, columns = affinity.shape
    row_best, row_next, row_at = np.full(rows, floor), np.full(rows, floor), np.full(rows, -1)
    column_best, column_next, column_at = np.full(columns, floor), np.full(columns, floor), np.full(columns, -1)
    for i in range(rows):
        if certain[i] >= 0:
            continue
        for j in range(columns):
            value = affinity[i, j]
            if value <= floor or not free[j] or classes[0][i] != classes[1][j]:
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
def _any_from(
    clipped: Floats,
    classes: Pairs,
    score: tuple[Floats, Floats],
    weight: float,
    rows: Ints,
    columns: Ints,
    gate: float,
) -> bool:
    """Return whether any pair of these rows and columns reaches the gate."""
    for i in rows:
        for j in columns:
            if classes[0][i] == classes[1][j] and clipped[i, j] - weight * abs(score[0][i] - score[1][j]) >= gate:
                return True
    return False
