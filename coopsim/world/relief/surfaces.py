"""Surfaces of roads: crowns and speed humps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats
from coopsim.world.places.relief import Relief

TAPER_M = 8.0
"""Over which a crown rises from the flat ground of a junction."""

_STRAIGHT_RAD = 1e-3  # corners of less are no corners


def crown_triangles(line: Floats, half_m: float, slope: float) -> Floats:
    """Return a crowned surface (T, 3, 3) m over a carriageway, counter-clockwise from above.

    A road that is too short to rise, stay and fall has none. Like the roof of a house with hips, the surface is made of
    planes where the road is straight, and meets the flat ground on all sides.

    Args:
        line: (K, 2) m, along the middle.
        half_m: distance from the middle to each gutter.
        slope: fall from the middle to the gutters, m per m.
    """
    along_m = along_of(line)
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


def _turns(line: Floats) -> Floats:
    """Return the angles (K - 2,) at the inner corners of a line (K, 2), rad."""
    step = np.diff(line, axis=0)
    heading = exact.arctan2(step[:, 1], step[:, 0])
    turns: Floats = np.abs((np.diff(heading) + np.pi) % (2 * np.pi) - np.pi)
    return turns


_SIDE_M = 0.4  # over which a hump falls to the road at its sides, for the water along the kerbs; ours
_ALONG = 12  # parts in which the profile is cut: a hump 0.1 m high differs from the sine by less than 2 mm


USUAL_LENGTH_M, USUAL_HEIGHT_M = 3.7, 0.075
"""Of Britain's standard hump (TRL report 377), at the height that buses accept (TRL report 186)."""


@dataclass(frozen=True, slots=True)
class Hump:
    """Hump of sinusoidal profile around a middle (x, y), as in the Netherlands, Denmark and Britain.

    TRL report 377 (1998) describes them. The heading is that of travel over it; the width is across the road.
    """

    x_m: float
    y_m: float
    heading_rad: float
    width_m: float
    length_m: float
    height_m: float

    def triangles(self, road: Relief) -> Floats:
        """Return the surface (T, 3, 3) m of the hump on a road, counter-clockwise from above."""
        half_m = self.width_m / 2
        along = np.linspace(-0.5, 0.5, _ALONG + 1)
        # A column in the middle, where a crowned road has its ridge.
        aside = np.array([-half_m, -half_m + _SIDE_M, 0.0, half_m - _SIDE_M, half_m])
        rise = self.height_m / 2 * (1 + exact.cos(2 * np.pi * along))[:, None] * np.array([0.0, 1.0, 1.0, 1.0, 0.0])
        ahead_m, left_m = (each.ravel() for each in np.meshgrid(along * self.length_m, aside, indexing="ij"))
        cos, sin = exact.cos(self.heading_rad), exact.sin(self.heading_rad)
        places = np.column_stack([self.x_m + cos * ahead_m - sin * left_m, self.y_m + sin * ahead_m + cos * left_m])
        corners = np.column_stack([places, road.heights(places) + rise.ravel()])
        return corners[_faces(_ALONG + 1, len(aside))]


def _faces(rows: int, columns: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the two triangles (F, 3) of each cell of a grid of corners: rows lead ahead, columns to the left."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    ahead, left = first + columns, first + 1
    return np.vstack([np.column_stack([first, ahead, ahead + 1]), np.column_stack([first, ahead + 1, left])])
