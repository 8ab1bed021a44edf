"""Crowned roads: from the gutters up to the middle, flat at both ends."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

TAPER_M = 8.0
"""Over which a crown rises from the flat ground of a junction."""

_STRAIGHT_RAD = 1e-3  # corners of less are no corners


def crown_triangles(line: Floats, half_m: float, slope: float) -> Floats:
    """Return a crowned surface (T, 3, 3) m over a carriageway, counter-clockwise from above.

    A road that is too short to rise, stay and fall has none. Like the roof of a house with hips, the surface is made of
    planes where the road is straight, and meets the flat ground on all sides.

    Args:
        line: (K, 2) m, along the middle.
        half_m: from the middle to each gutter.
        slope: fall from the middle to the gutters, m per m.
    """
    along_m = _along(line)
    if along_m[-1] < 3 * TAPER_M:
        return np.zeros((0, 3, 3))
    normal = normals_of(line)
    corner = np.append(np.append(True, _turns(line) > _STRAIGHT_RAD), True)
    kept_m = np.unique(np.concatenate([along_m[corner], [TAPER_M, along_m[-1] - TAPER_M]]))
    ridge, gutter = np.zeros((2, len(kept_m), 3))
    for axis in range(2):
        ridge[:, axis] = np.interp(kept_m, along_m, line[:, axis])
        gutter[:, axis] = half_m * np.interp(kept_m, along_m, normal[:, axis])
    to_end_m = np.minimum(kept_m, along_m[-1] - kept_m)
    ridge[:, 2] = slope * half_m * np.clip(to_end_m / TAPER_M, 0.0, 1.0)
    level = ridge * [1.0, 1.0, 0.0]
    return np.concatenate([_side(level - gutter, ridge), _side((level + gutter)[::-1], ridge[::-1])])


def normals_of(line: Floats) -> Floats:
    """Return vectors (K, 2) from the corners of a line (K, 2) to the line 1 m to its left."""
    along = np.diff(line, axis=0)
    along /= exact.norm(along, axis=1, keepdims=True)
    before, after = np.vstack([along[:1], along]), np.vstack([along, along[-1:]])
    mean = (before + after) / 2
    mean /= np.square(mean).sum(axis=1, keepdims=True)  # longer at corners
    return np.column_stack([-mean[:, 1], mean[:, 0]])


def _side(gutter: Floats, ridge: Floats) -> Floats:
    """Return the triangles between a gutter (K, 3) and a ridge (K, 3) on its left, cut along the hips at the ends."""
    a, b, c, d = gutter[:-1], gutter[1:], ridge[1:], ridge[:-1]
    rising = (d[:, 2] <= c[:, 2])[:, None]
    first = np.stack([a, b, np.where(rising, c, d)], axis=1)
    second = np.stack([np.where(rising, a, b), c, d], axis=1)
    return np.concatenate([first, second])


def _along(line: Floats) -> Floats:
    """Return the distance (K,) of each corner from the start of a line (K, 2)."""
    return np.concatenate([[0.0], np.cumsum(exact.norm(np.diff(line, axis=0), axis=1))])


def _turns(line: Floats) -> Floats:
    """Return the angles (K - 2,) at the inner corners of a line (K, 2), rad."""
    step = np.diff(line, axis=0)
    heading = exact.arctan2(step[:, 1], step[:, 0])
    turns: Floats = np.abs((np.diff(heading) + np.pi) % (2 * np.pi) - np.pi)
    return turns
