"""A quick look at the objects of a frame, compiled: whether anything about them is wrong, but not what."""

from __future__ import annotations

import numpy as np

from coopsim.support.arrays import Floats, Ints
from coopsim.support.kernels import njit


@njit(cache=True, nogil=True)
def are_sound(boxes: Floats, ids: Ints, label: Ints, classes: int) -> bool:
    """Return whether boxes (N, 7) are finite and have sizes > 0, ids (N,) are unique, and labels (N,) below `classes`.

    All arrays are contiguous, and `ids` and `label` read-only: one layout, compiled once.
    """
    for i in range(len(boxes)):
        for j in range(7):
            if not np.isfinite(boxes[i, j]):
                return False
        if boxes[i, 3] <= 0 or boxes[i, 4] <= 0 or boxes[i, 5] <= 0:
            return False
        if label[i] < 0 or label[i] >= classes:
            return False
    ordered = np.sort(ids)
    for i in range(1, len(ordered)):  # noqa: SIM110  (numba takes no generator)
        if ordered[i] == ordered[i - 1]:
            return False
    return True
