"""What duplicates of one object become together: their mean, and the agents that saw any of them, as kernels."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask


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
