"""The draws of `coopsim.support.rng.uniform_draws`, one by one, for loops that are compiled."""

from __future__ import annotations

import numpy as np

from coopsim.support.kernels import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11, _1 = (np.uint64(bits) for bits in (30, 27, 31, 11, 1))


@njit(cache=True, nogil=True)
def uniform_at(key: np.uint64, owner: np.uint64, count: np.uint64, column: np.uint64) -> float:
    """Return one number of `uniform_draws`: of an owner with `count` of them, the one in this column."""
    state = key + (owner * count + column + _1) * _GOLDEN
    mixed = (state ^ (state >> _30)) * _FIRST
    mixed = (mixed ^ (mixed >> _27)) * _SECOND
    mixed = mixed ^ (mixed >> _31)
    return np.float64(mixed >> _11) * 2.0**-53
