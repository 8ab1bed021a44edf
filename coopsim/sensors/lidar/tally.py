"""Numbers of LiDAR returns, or of pixels, by actor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.support.kernels import njit
from coopsim.types import Ints, Sweep


def count_returns(sweeps: Mapping[str, Sweep], ids: Ints) -> Ints:
    """Count the returns from each of the actors `ids` (N,), distinct, over all sweeps; returns (N,).

    Raises:
        InvalidValueError: a sweep has no instance ids.
    """
    counts = np.zeros(len(ids), dtype=np.int64)
    for name, sweep in sweeps.items():
        if sweep.instance is None:
            raise InvalidValueError(f"sweep {name!r} has no instance ids to count returns by")
        counts += count_instances(sweep.instance, ids)
    return counts


def count_instances(instance: Ints, ids: Ints) -> Ints:
    """Count how often each of the actors `ids` (N,), distinct, is among instances (P,); returns (N,)."""
    counts = np.empty(len(ids), dtype=np.int64)
    order = np.argsort(ids)
    counts[order] = _tally(instance, ids[order])
    return counts


@njit(cache=True, nogil=True)
def _tally(instance: Ints, ids: Ints) -> Ints:
    """Count how often each of `ids` (N,), which rise, is among instances (P,); returns (N,)."""
    counts = np.zeros(len(ids) + 1, np.int64)  # the last is of all others
    slot = len(ids)
    for p in range(len(instance)):
        if p == 0 or instance[p] != instance[p - 1]:  # neighbouring rays mostly hit the same actor
            slot = np.searchsorted(ids, instance[p])
            if slot < len(ids) and ids[slot] != instance[p]:
                slot = len(ids)
        counts[slot] += 1
    return counts[:-1]
