"""The middle and width of a lanelet from its two borders."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from coopsim.data.maps.street_map import length_of
from coopsim.data.maps.turns import joined
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_STEP_M, _FINE_M = 2.0, 0.25
"""Distance of points of the longer border, and of those of the other, one of which is the nearest."""


def turned(left: Floats, right: Floats) -> tuple[bool, bool]:
    """Return whether each border (K, 3) must be reversed, so that both have the direction that `left` is left of."""
    along = exact.norm(left[0] - right[0]) + exact.norm(left[-1] - right[-1])
    against = exact.norm(left[0] - right[-1]) + exact.norm(left[-1] - right[0])
    is_against = bool(along > against)
    ring = np.concatenate([left, right if is_against else right[::-1]])[:, :2] - left[0, :2]
    after = np.roll(ring, -1, axis=0)
    is_backward = bool((ring[:, 0] * after[:, 1] - ring[:, 1] * after[:, 0]).sum() > 0.0)
    return is_backward, is_backward != is_against


def middle_of(left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the middle (K, 3) and width (K,), m, of a lane from its borders in the direction of travel.

    Points of the longer border, at most 2 m apart, are paired with the nearest ones of the other, in order.
    """
    longer, other = (left, right) if length_of(left) >= length_of(right) else (right, left)
    points, fine = divided(longer, _STEP_M), divided(other, _FINE_M)
    near = np.asarray(KDTree(fine).query(points)[1])
    near[0], near[-1] = 0, len(fine) - 1
    partners = fine[np.maximum.accumulate(near)]
    return joined([((points + partners) / 2, exact.norm((points - partners)[:, :2]))])


def divided(line: Floats, step_m: float) -> Floats:
    """Return a line (K, 3) with more points on it, at most `step_m` apart."""
    counts = np.maximum(np.ceil(exact.norm(np.diff(line, axis=0)) / step_m), 1.0).astype(np.int64)
    piece = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[piece]
    points = line[piece] + share[:, None] * (line[piece + 1] - line[piece])
    return np.concatenate([points, line[-1:]])
