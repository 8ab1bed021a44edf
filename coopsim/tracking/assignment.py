"""One-to-one matching of rows and columns of an affinity matrix, above a gate."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

Pairs = tuple[Ints, Ints]
"""Matched rows and matched columns, (K,) each."""


class Assigner(Protocol):
    """Matches rows to columns."""

    def __call__(self, affinity: Floats, gate: float, /) -> Pairs:
        """Pairs with an affinity of at least `gate`; -inf and NaN are never matched."""


def hungarian(affinity: Floats, gate: float) -> Pairs:
    """The matching with the largest sum of affinities (Kuhn 1955), without the pairs below the gate.

    As in AB3DMOT the gate is applied to the optimal matching: a pair below it may take part in the optimum,
    and is then left unmatched.
    """
    possible = np.isfinite(affinity)
    if not possible.any():
        return _none()
    finite = affinity[possible]
    # An impossible pair costs more than any number of possible ones can gain.
    worst = finite.min() - (1.0 + np.ptp(finite)) * (1 + min(affinity.shape))
    rows, columns = linear_sum_assignment(np.where(possible, affinity, worst), maximize=True)
    kept = possible[rows, columns] & (affinity[rows, columns] >= gate)
    return rows[kept], columns[kept]


def greedy(affinity: Floats, gate: float) -> Pairs:
    """Pairs in order of falling affinity, each taken if its row and its column are still free."""
    candidates = np.argwhere(affinity >= gate)  # NaN compares false
    candidates = candidates[np.isfinite(affinity[candidates[:, 0], candidates[:, 1]])]
    order = np.argsort(-affinity[candidates[:, 0], candidates[:, 1]], kind="stable")
    rows, columns = [], []
    free_row, free_column = np.ones(affinity.shape[0], dtype=bool), np.ones(affinity.shape[1], dtype=bool)
    for row, column in candidates[order]:
        if free_row[row] and free_column[column]:
            free_row[row] = free_column[column] = False
            rows.append(row)
            columns.append(column)
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _none() -> Pairs:
    return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
