"""A lane along a line of many points: one lane, whose heading is blended at its corners.

The kernels use sums, products and square roots alone, so places are the same on every processor. They take corners of
all lanes of a network, of which a lane's begin at `first`.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.arrays import dtype_of
from coopsim.support.kernels import njit
from coopsim.world.places.road_network import DEFAULT_SPEED_M_S, Lane

BLEND_M = 3.0
"""Farthest from a corner at which the heading begins to turn; at most to the middles of both pieces."""

LATERAL_M_S2 = 2.0
"""Largest lateral acceleration that passengers find comfortable in a bend."""

_NEAR_M, _FAR_M = 2.5, 15.0  # least and greatest share of each piece at a corner in the length over which it bends


class Corner(Protocol):
    """A point of a polyline, and the straight piece that begins there; the last point repeats the last piece."""

    x: float  # m
    y: float  # m
    along: float  # distance from the lane's start, m
    step: float  # length of the piece, m
    dir_x: float  # of the piece
    dir_y: float  # of the piece
    heading: float  # of the piece, rad; it goes on turning, and so may leave [-pi, pi)
    radius: float  # of the bend at the point, m; infinite where the line is straight
    speed: float  # at which that bend is comfortable, m/s
    width: float  # of the lane, m


CORNER = dtype_of(Corner)


BEND_M, LONGEST_M = 20.0, 40.0
"""Radius below which a bend is narrow, and length from which a lane is too long for vehicles to wait before it for
what comes in its bend."""


class PolylineLane(Lane):
    """A lane along points (K, 2) m, no two in a row the same.

    Attributes:
        corners: (K,) `CORNER`.

    Args:
        points: the middle line.
        widths: (K,) m, at the points; between them it changes evenly. `width` is the largest.
        speed_limit: limit, m/s.
        forbidden: no driver may change to it.
    """

    def __init__(
        self,
        points: ArrayLike,
        widths: ArrayLike = 4.0,
        speed_limit: float = DEFAULT_SPEED_M_S,
        forbidden: bool = False,
    ) -> None:
        line = np.array(points, dtype=np.float64)
        steps = np.diff(line, axis=0)
        self.corners = corners = np.zeros(len(line), CORNER)
        corners["width"] = widths
        super().__init__(float(corners["width"].max()), speed_limit, forbidden)
        corners["x"], corners["y"] = line.T
        pieces = np.arange(len(line)).clip(max=len(steps) - 1)
        length = exact.norm(steps)
        corners["step"] = length[pieces]
        corners["dir_x"], corners["dir_y"] = (steps / length[:, None])[pieces].T
        corners["along"][1:] = np.cumsum(length)
        heading = exact.arctan2(steps[:, 1], steps[:, 0])
        turned = np.concatenate([[0.0], np.cumsum(wrap_angle(np.diff(heading)))])
        corners["heading"] = (heading[0] + turned)[pieces]
        self.length = float(corners["along"][-1])
        corners["radius"] = self._radii()
        corners["speed"] = np.sqrt(LATERAL_M_S2 * corners["radius"])
        self.tightest_m = float(corners["radius"].min())

    def _radii(self) -> Floats:
        """Return the radii (K,) m of the bends at the points: a length around each, by the turn along it."""
        along, step = self.corners["along"], self.corners["step"]
        half = np.clip(step / 2, _NEAR_M, _FAR_M)
        before, after = along - np.concatenate([half[:1], half[:-1]]), along + half
        turn = np.abs([self.heading_at(b) - self.heading_at(a) for a, b in zip(before, after, strict=True)])
        return np.where(turn > 1e-9, (after - before) / np.maximum(turn, 1e-9), np.inf)

    @property
    def points(self) -> Floats:
        """The middle line (K, 2) m."""
        return np.column_stack([self.corners["x"], self.corners["y"]])

    def stations(self, step_m: float) -> Floats:
        return np.array(self.corners["along"])

    def widths_at(self, along_m: Floats) -> Floats:
        return np.asarray(np.interp(along_m, self.corners["along"], self.corners["width"]))

    def positions(self, along_m: Floats, aside_m: float) -> Floats:
        at = self.corners[np.searchsorted(self.corners["along"], along_m, "right").clip(1, len(self.corners) - 1) - 1]
        beyond = along_m - at["along"]
        x = at["x"] + beyond * at["dir_x"] - aside_m * at["dir_y"]
        y = at["y"] + beyond * at["dir_y"] + aside_m * at["dir_x"]
        return np.column_stack([x, y])

    def heading_at(self, along_m: float) -> float:
        return float(polyline_heading(self.corners, 0, len(self.corners), along_m))

    def radius_at(self, along_m: float) -> float:
        return float(polyline_radius(self.corners, 0, len(self.corners), along_m))

    def local_coordinates(self, position: Floats) -> tuple[float, float]:
        along, aside = polyline_coordinates(self.corners, 0, len(self.corners), float(position[0]), float(position[1]))
        return float(along), float(aside)


@njit(cache=True, nogil=True)
def polyline_coordinates(corners: NDArray[Any], first: int, count: int, x: float, y: float) -> tuple[float, float]:
    """Return along and aside of a place, by its nearest piece; the first and last piece go on beyond the line's ends.

    Outside a corner the place's distance to it is aside.
    """
    last, piece, least = first + count - 2, first, np.inf
    for k in range(first, last + 1):
        corner: Corner = corners[k]
        dx, dy = x - corner.x, y - corner.y
        along = min(max(dx * corner.dir_x + dy * corner.dir_y, 0.0), corner.step)
        ex, ey = dx - along * corner.dir_x, dy - along * corner.dir_y
        if ex * ex + ey * ey < least:
            piece, least = k, ex * ex + ey * ey
    nearest: Corner = corners[piece]
    dx, dy = x - nearest.x, y - nearest.y
    along, aside = dx * nearest.dir_x + dy * nearest.dir_y, dy * nearest.dir_x - dx * nearest.dir_y
    if (along < 0 and piece > first) or (along > nearest.step and piece < last):
        along, aside = min(max(along, 0.0), nearest.step), math.copysign(math.sqrt(least), aside)
    return nearest.along + along, aside


@njit(cache=True, nogil=True)
def piece_at(corners: NDArray[Any], first: int, count: int, along: float) -> int:
    """Return the number of the piece at a distance along the line; beyond its ends the first or last piece."""
    low, high = first, first + count - 2
    while low < high:
        middle = (low + high + 1) // 2
        if corners[middle].along <= along:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, nogil=True)
def polyline_position(corners: NDArray[Any], first: int, count: int, along: float) -> tuple[float, float]:
    """Return a place on the middle line."""
    corner: Corner = corners[piece_at(corners, first, count, along)]
    beyond = along - corner.along
    return corner.x + beyond * corner.dir_x, corner.y + beyond * corner.dir_y


@njit(cache=True, nogil=True)
def polyline_heading(corners: NDArray[Any], first: int, count: int, along: float) -> float:
    """Return the heading, rad: that of a piece, and around a corner evenly from that before to that after it."""
    k = piece_at(corners, first, count, along)
    beyond, left = along - corners[k].along, corners[k].along + corners[k].step - along
    if beyond < left and k > first:
        return _blended(corners[k - 1], corners[k], beyond)
    if beyond >= left and k < first + count - 2:
        return _blended(corners[k], corners[k + 1], -left)
    return float(corners[k].heading)


@njit(cache=True, nogil=True)
def _blended(before: Corner, after: Corner, beyond: float) -> float:
    """Return the heading at a distance beyond the corner between two pieces, or before it, below zero."""
    reach_before, reach_after = min(before.step / 2, BLEND_M), min(after.step / 2, BLEND_M)
    share = min(max((reach_before + beyond) / (reach_before + reach_after), 0.0), 1.0)
    return before.heading + share * (after.heading - before.heading)


@njit(cache=True, nogil=True)
def polyline_radius(corners: NDArray[Any], first: int, count: int, along: float) -> float:
    """Return the radius of the bend at a distance along the line, m; infinite far from corners."""
    k = piece_at(corners, first, count, along)
    beyond, left = along - corners[k].along, corners[k].along + corners[k].step - along
    if min(beyond, left) > _FAR_M:
        return np.inf
    return float(corners[k].radius if beyond < left else corners[k + 1].radius)


@njit(cache=True, nogil=True)
def polyline_speed(corners: NDArray[Any], first: int, count: int, start_m: float, braking_m_s2: float) -> float:
    """Return the speed now from which a braking makes all bends ahead comfortable, m/s.

    `start_m` is the distance to the line's start, below zero on it.
    """
    speed = np.inf
    for k in range(first, first + count):
        corner: Corner = corners[k]
        ahead_m = start_m + corner.along
        if ahead_m > -_NEAR_M and corner.speed < np.inf:
            speed = min(speed, math.sqrt(corner.speed * corner.speed + 2 * braking_m_s2 * max(ahead_m, 0.0)))
    return speed
