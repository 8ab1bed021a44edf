"""Pairs of agents that are out of each other's range."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Mask

_ROUNDING = 1e-9
"""Relative difference from the range below which a distance is computed by itself, so that no pair depends on how many
there are."""


def out_of_range(places_m: Floats, range_m: float) -> Mask:
    """Return the mask (A, A) of pairs of agents at (A, 3) m that are farther apart than `range_m`."""
    if math.isinf(range_m):
        return np.zeros((len(places_m), len(places_m)), dtype=np.bool_)
    apart = places_m[:, None] - places_m
    square = np.einsum("ijk,ijk->ij", apart, apart)
    far: Mask = square > range_m**2
    near = np.abs(square - range_m**2) <= _ROUNDING * range_m**2
    for i, j in np.argwhere(near).tolist() if near.any() else ():
        far[i, j] = math.sqrt(apart[i, j].dot(apart[i, j])) > range_m
    return far
