"""Speed humps: a smooth rise across a road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.relief.relief import Relief

_SIDE_M = 0.4  # over which a hump falls to the road at its sides, for the water along the kerbs; ours
_ALONG = 12  # parts in which the profile is cut: a hump 0.1 m high differs from the sine by less than 2 mm


USUAL_LENGTH_M, USUAL_HEIGHT_M = 3.7, 0.075
"""Of Britain's standard hump (TRL report 377), at the height that buses accept (TRL report 186)."""

LENGTHS_M, HEIGHTS_M = (0.9, 20.0), (0.025, 0.1)
"""Accepted sizes: the least length, and both heights, are those of Britain's regulations of 1999."""


@dataclass(frozen=True, slots=True)
class Hump:
    """A hump of sinusoidal profile, as they are in the Netherlands, Denmark and Britain (TRL report 377, 1998).

    Attributes:
        x_m: of its middle.
        y_m: of its middle.
        heading_rad: of travel over it.
        width_m: across the road.
        length_m: along it.
        height_m: over the road.
    """

    x_m: float
    y_m: float
    heading_rad: float
    width_m: float
    length_m: float
    height_m: float

    def triangles(self, road: Relief) -> Floats:
        """Return its surface (T, 3, 3) m on a road, counter-clockwise from above."""
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
