"""Matches of every two agents' boxes by 3D IoU."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.assignment import match_pairs
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask


def match_agents(boxes: Floats, owner: Ints, label: Ints, threshold: float) -> tuple[Ints, Floats]:
    """Match the boxes of every two agents, one to one for the largest sum of IoU.

    Args:
        boxes: (N, 7), finite.
        owner: (N,) number of each box's agent, from 0.
        label: (N,) classes; only boxes of a class match.
        threshold: smallest 3D IoU of a match, > 0.

    Returns:
        The pairs (K, 2) of rows, the lower agent's first, and their IoU (K,), in order of agents and rows.
    """
    overlap = iou_3d(boxes, boxes)
    rows, columns = np.nonzero((overlap > 0) & (owner[:, None] < owner) & (label[:, None] == label))
    order = np.lexsort((columns, rows, owner[columns], owner[rows]))
    rows, columns = rows[order], columns[order]
    value = overlap[rows, columns]
    kept = _matched(rows, columns, value, owner) & (value >= threshold)
    return np.column_stack([rows, columns])[kept], value[kept]


@njit(cache=True, nogil=True)
def _matched(rows: Ints, columns: Ints, value: Floats, owner: Ints) -> Mask:
    """Return which pairs (K,), in order of their agents, are in the best matching of their two agents."""
    matched = np.zeros(len(rows), dtype=np.bool_)
    first = 0
    for end in range(1, len(rows) + 1):
        if end < len(rows) and owner[rows[end]] == owner[rows[first]] and owner[columns[end]] == owner[columns[first]]:
            continue
        for each in match_pairs(len(owner), len(owner), rows[first:end], columns[first:end], value[first:end]):
            if each >= 0:
                matched[first + each] = True
        first = end
    return matched
