"""Fused boxes as arrays of numbers, for kernels: each box, and what is believed of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit

BEST, CHANCE, NEAREST, SCORE, AWAY = range(5)
"""Columns of `Believed.values`: the best score of all agents that see it, and those of `FusedBoxes`."""

_CLEARNESS_POWER = 4
"""Power of the score in the weights of clearly seen boxes: one box at 0.8 counts for 16 at 0.4."""


class Believed(NamedTuple):
    """N fused boxes.

    Attributes:
        boxes: (N, 7).
        values: (N, 5) best score, chance, nearest m, score of the likeliest agent, away m; see `FusedBoxes`.
        label: (N,) classes.
        origin: (N,) the row, among the boxes of all agents, whose covariance and embedding the box carries.
    """

    boxes: Floats
    values: Floats
    label: Ints
    origin: Ints


@njit(cache=True, nogil=True)
def room_for(count: int) -> Believed:
    """Return room for fused boxes."""
    ids = np.empty(2 * count, dtype=np.int64)
    return Believed(np.empty((count, 7)), np.empty((count, 5)), ids[:count], ids[count:])


@njit(cache=True, nogil=True)
def of_agent(boxes: Floats, score: Floats, label: Ints, first: int) -> Believed:
    """Return the boxes (N, 7) of one agent; `first` is the row of the first one among those of all agents."""
    values, away_m = np.ones((len(boxes), 5)), away(boxes, clear_middle(boxes, score))
    values[:, BEST], values[:, SCORE] = score, score
    values[:, NEAREST], values[:, AWAY] = away_m, away_m
    return Believed(boxes, values, label, np.arange(first, first + len(boxes)))


@njit(cache=True, nogil=True)
def column(believed: Believed, which: int) -> Floats:
    """Return a column (N,) of `values`."""
    return believed.values[:, which].copy()


@njit(cache=True, nogil=True)
def take(believed: Believed, rows: Ints) -> Believed:
    """Return some of the boxes."""
    return Believed(believed.boxes[rows], believed.values[rows], believed.label[rows], believed.origin[rows])


@njit(cache=True, nogil=True)
def first_of(believed: Believed, count: int) -> Believed:
    """Return the first boxes, as a view."""
    boxes, values, label, origin = believed
    return Believed(boxes[:count], values[:count], label[:count], origin[:count])


@njit(cache=True, nogil=True)
def put(believed: Believed, row: int, source: Believed, k: int) -> None:
    """Write box k of a source to a row."""
    believed.boxes[row], believed.values[row] = source.boxes[k], source.values[k]
    believed.label[row], believed.origin[row] = source.label[k], source.origin[k]


@njit(cache=True, nogil=True, error_model="numpy")
def clear_middle(boxes: Floats, score: Floats) -> Floats:
    """Return the middle (2,) m over ground of an agent's clear area; the origin without boxes (N, 7)."""
    best, middle, total = 1e-6, np.zeros(2), 0.0
    for value in score:
        best = max(best, value)
    for k in range(len(boxes)):
        weight = (max(score[k], 1e-6) / best) ** _CLEARNESS_POWER
        middle[0] += weight * boxes[k, 0]
        middle[1] += weight * boxes[k, 1]
        total += weight
    return middle / total if len(boxes) else middle


@njit(cache=True, nogil=True)
def away(boxes: Floats, middle: Floats) -> Floats:
    """Return the distances (N,) m over ground of boxes (N, 7) from a place (2,)."""
    away_m = np.empty(len(boxes))
    for k in range(len(boxes)):
        x, y = boxes[k, 0] - middle[0], boxes[k, 1] - middle[1]
        away_m[k] = np.sqrt(x * x + y * y)
    return away_m
