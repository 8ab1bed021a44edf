"""Matching one to one of rows and columns of an affinity matrix, above a gate."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, Mask
from coopsim.support.kernels import njit

Pairs = tuple[Ints, Ints]
"""Matched rows and matched columns, (K,) each."""

# Where at most this share of so many pairs is possible, the sparse solver is faster (measured up to 3000 x 3000).
_SPARSE_SHARE, _SPARSE_FROM = 0.1, 10_000


class Assigner(Protocol):
    """A rule that matches rows to columns."""

    def __call__(self, affinity: Floats, gate: float, /) -> Pairs:
        """Return pairs with an affinity of at least `gate`; infinite ones and NaN are never matched."""


def hungarian(affinity: Floats, gate: float) -> Pairs:
    """Return the matching with the largest sum of affinities (Kuhn 1955), without the pairs below the gate.

    As many pairs as possible are matched, then for the largest sum. As in AB3DMOT the gate is applied to the optimal
    matching: a pair below it may take part in the optimum, and is then left unmatched. Rows come in order.

    Args:
        affinity: (N, M), larger is better; -inf and NaN are impossible.
        gate: smallest affinity of a pair.
    """
    possible = np.isfinite(affinity)
    count = np.count_nonzero(possible)
    if count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    sparse = affinity.size >= _SPARSE_FROM and count <= _SPARSE_SHARE * affinity.size
    rows, columns = (_best_of_few if sparse else _best_of_all)(affinity, possible)
    kept = affinity[rows, columns] >= gate
    return rows[kept], columns[kept]


def nearest_pairs(apart: Floats, most: float) -> Pairs:
    """Return the matching of rows and columns with the smallest sum of distances, of as many pairs as possible.

    Pairs that are farther apart than `most` take no part: in `hungarian` they would draw near ones apart. Rows come in
    order.

    Args:
        apart: (N, M) distances; inf and NaN are impossible.
        most: largest distance of a pair.
    """
    return hungarian(np.where(apart <= most, -apart, -np.inf), -most)


def greedy(affinity: Floats, gate: float) -> Pairs:
    """Take pairs in order of falling affinity, each if its row and its column are still free.

    Of equal pairs the one in the lower row, then in the lower column, comes first.

    Args:
        affinity: (N, M), larger is better; infinite ones and NaN are never matched.
        gate: smallest affinity of a pair.
    """
    rows, columns = np.nonzero(np.isfinite(affinity) & (affinity >= gate))
    order = np.lexsort((columns, rows, -affinity[rows, columns]))
    rows, columns = rows[order], columns[order]
    kept = _first_come(rows, columns, *affinity.shape)
    return rows[kept], columns[kept]


def _best_of_all(affinity: Floats, possible: NDArray[np.bool_]) -> Pairs:
    finite = affinity[possible]
    # An impossible pair costs more than any number of possible ones can gain.
    worst = finite.min() - (1.0 + np.ptp(finite)) * (1 + min(affinity.shape))
    rows, columns = linear_sum_assignment(np.where(possible, affinity, worst), maximize=True)
    kept = possible[rows, columns]
    return rows[kept], columns[kept]


def _best_of_few(affinity: Floats, possible: NDArray[np.bool_]) -> Pairs:
    """Solve for the possible pairs only: each row may also stay unmatched, at a cost above what all pairs can gain."""
    count, width = affinity.shape
    rows, columns = np.nonzero(possible)
    value = affinity[rows, columns]
    cost = 1.0 + value.max() - value  # explicit zeros would be no pairs
    unmatched = (1.0 + np.ptp(value)) * (1 + min(affinity.shape))
    every = np.arange(count)
    weight = np.concatenate([cost, np.full(count, 1.0 + unmatched)])
    where = (np.concatenate([rows, every]), np.concatenate([columns, width + every]))
    row, column = min_weight_full_bipartite_matching(coo_array((weight, where), shape=(count, width + count)).tocsr())
    kept = column < width
    return row[kept].astype(np.int64), column[kept].astype(np.int64)


@njit(cache=True, nogil=True)
def _first_come(rows: Ints, columns: Ints, count: int, width: int) -> Mask:
    """Return the mask (K,) of pairs whose row and column no pair before them has."""
    kept, free, free_column = np.zeros(len(rows), np.bool_), np.ones(count, np.bool_), np.ones(width, np.bool_)
    for k in range(len(rows)):
        if free[rows[k]] and free_column[columns[k]]:
            kept[k], free[rows[k]], free_column[columns[k]] = True, False, False
    return kept


@njit(cache=True, nogil=True)
def match_pairs(rows: int, columns: int, pair_row: Ints, pair_column: Ints, weight: Floats) -> Ints:
    """Match rows and columns one to one for the largest sum of weights, with few pairs possible.

    The pairs are distinct, and given by their rows (P,), columns (P,) and weights (P,); a weight of 0 is no pair.
    Return the number (rows,) of each row's pair, or -1.
    """
    chosen = np.full(rows, -1)
    row_degree, column_degree = np.zeros(rows, np.int64), np.zeros(columns, np.int64)
    for p in range(len(weight)):
        if weight[p] > 0:
            row_degree[pair_row[p]] += 1
            column_degree[pair_column[p]] += 1
    # Most rows have a single candidate that has no other row: only the rest needs an optimisation.
    row_slot, column_slot = np.full(rows, -1), np.full(columns, -1)
    hard_rows, hard_columns = 0, 0
    for p in range(len(weight)):
        row, column = pair_row[p], pair_column[p]
        if weight[p] <= 0:
            continue
        if row_degree[row] == 1 and column_degree[column] == 1:
            chosen[row] = p
            continue
        if row_slot[row] < 0:
            row_slot[row] = hard_rows
            hard_rows += 1
        if column_slot[column] < 0:
            column_slot[column] = hard_columns
            hard_columns += 1
    if hard_rows == 0:
        return chosen
    dense = np.zeros((hard_rows, max(hard_rows, hard_columns)))
    pair_at = np.full(dense.shape, -1)
    for p in range(len(weight)):
        row, column = row_slot[pair_row[p]], column_slot[pair_column[p]]
        if weight[p] > 0 and row >= 0 and column >= 0:
            dense[row, column] = -weight[p]
            pair_at[row, column] = p
    assigned = cheapest_assignment(dense)
    for row in range(rows):
        if row_slot[row] >= 0:
            chosen[row] = pair_at[row_slot[row], assigned[row_slot[row]]]
    return chosen


@njit(cache=True, nogil=True)
def cheapest_assignment(cost: Floats) -> Ints:
    """Return the column (n,) of each row in the assignment of least total cost (n, m), n <= m.

    Shortest augmenting paths with potentials (Jonker and Volgenant 1987), for kernels; others have `hungarian`.
    """
    rows, columns = cost.shape
    u, v = np.zeros(rows + 1), np.zeros(columns + 1)
    row_of, way = np.zeros(columns + 1, np.int64), np.zeros(columns + 1, np.int64)
    for row in range(1, rows + 1):
        row_of[0] = row
        column = 0
        shortest, done = np.full(columns + 1, np.inf), np.zeros(columns + 1, np.bool_)
        while row_of[column] != 0:
            done[column] = True
            here = row_of[column]
            step, following = extend_path(cost[here - 1], u[here], v, done, shortest, way, column)
            shift_potentials(step, row_of, u, v, done, shortest)
            column = following
        reassign(column, row_of, way)
    assigned = np.full(rows, -1)
    for j in range(1, columns + 1):
        if row_of[j] > 0:
            assigned[row_of[j] - 1] = j - 1
    return assigned


# Steps of the above, for kernels that compute costs only where a path comes by. Rows and columns count from 1; column 0
# stands for the row from which the path begins.


@njit(cache=True, nogil=True)
def extend_path(
    cost: Floats, potential: float, v: Floats, done: Mask, shortest: Floats, way: Ints, column: int
) -> tuple[float, int]:
    """Lead shortest paths on from a row with these costs (m,); return the step to the nearest column, and that column.

    The row has a potential and is that of `column`; v (m + 1,) are those of columns. `shortest` and `way` (m + 1,), the
    lengths of paths and the columns that they come from, are updated for the columns that are not `done`.
    """
    step, following = np.inf, 0
    for j in range(1, len(v)):
        if done[j]:
            continue
        reduced = cost[j - 1] - potential - v[j]
        if reduced < shortest[j]:
            shortest[j], way[j] = reduced, column
        if shortest[j] < step:
            step, following = shortest[j], j
    return step, following


@njit(cache=True, nogil=True)
def shift_potentials(step: float, row_of: Ints, u: Floats, v: Floats, done: Mask, shortest: Floats) -> None:
    """Move the potentials by a step, and the lengths of paths with them."""
    for j in range(len(v)):
        if done[j]:
            u[row_of[j]] += step
            v[j] -= step
        else:
            shortest[j] -= step


@njit(cache=True, nogil=True)
def reassign(column: int, row_of: Ints, way: Ints) -> None:
    """Give each column on a path, from its last one back, the row of the column before."""
    while column != 0:
        row_of[column] = row_of[way[column]]
        column = way[column]
