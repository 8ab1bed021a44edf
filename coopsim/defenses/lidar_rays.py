"""Rays of a receiver's LiDARs: which claimed objects they hit, and which they go through."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import Claim, Reception
from coopsim.support.kernels import njit
from coopsim.types import Ints

_Vector = tuple[float, float, float]

_GROUND_M = 0.3
"""Height above the bottom of a box below which points may be the ground's."""

_CORE = 0.7
"""Share of a box's length and width, and of its height, that rays must cross: bodies fill no box to its corners."""

_ERROR_M, _FASTEST_M_S = 0.7, 15.0
"""Error of a claimed place that is no contradiction, 0.2 m of two poses and 0.3 m of a detector at three sigma; and
speed of a late object of which none is stated, as in towns."""

_LONGEST_S = 1.0
"""Largest age with which the place of an object still gets less sure: later ones are hardly used."""


class LidarRays:
    """Rays of the receiver's LiDARs from their origin to what they hit; rays without a return say nothing."""

    def __init__(self, reception: Reception) -> None:
        self._sweeps = []
        for name, sweep in reception.observation.sweeps.items():
            mounting = reception.spec.lidars.get(name)
            if mounting is None or not len(sweep):
                continue
            origin = mounting.base_SE3_lidar.translation
            rays = sweep.points.astype(np.float64) - origin
            azimuth = np.arctan2(rays[:, 1], rays[:, 0])
            order = np.argsort(azimuth, kind="stable")
            self._sweeps.append((origin, azimuth[order], rays[order]))

    def of(self, claim: Claim) -> tuple[Ints, Ints]:
        """Return (N,) points on each claimed object, and (N,) rays through where it is said to be.

        An object may be off its place by errors of poses and detectors, and by its motion since capture.
        """
        found, age_s = claim.detections, min(max(claim.age_s, 0.0), _LONGEST_S)
        speed = np.full(len(found), _FASTEST_M_S)
        if found.velocity is not None:
            stated = np.hypot(*found.velocity.T)
            speed = np.where(np.isfinite(stated), np.minimum(stated, 2 * _FASTEST_M_S), speed)
        return self.count(found.boxes, _ERROR_M + speed * age_s)

    def count(self, boxes: Boxes3D, off_m: Floats) -> tuple[Ints, Ints]:
        """Return (N,) points in each box made larger by `off_m` (N,), and (N,) rays that cross its core and go on."""
        on, through = np.zeros((2, len(boxes)), dtype=np.int64)
        shapes = np.column_stack([boxes.center, boxes.size / 2, boxes.yaw, off_m]) if len(boxes) else np.empty((0, 8))
        for origin, azimuth, rays in self._sweeps:
            first, last = _between(azimuth, *_angles(boxes, off_m, origin))
            _count(shapes, origin, rays, first, last, on, through)
        return on, through


def _angles(boxes: Boxes3D, off_m: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Return directions (N,) of boxes from a LiDAR, and half the angles under which they are seen; pi if too near."""
    to = boxes.center[:, :2] - origin[:2]
    radius, away = np.hypot(*boxes.size[:, :2].T) / 2 + off_m, np.hypot(*to.T)
    half = np.where(away <= radius, np.pi, np.arcsin(radius / np.maximum(away, radius)))
    return np.arctan2(to[:, 1], to[:, 0]), half


def _between(azimuth: Floats, middle: Floats, half: Floats) -> tuple[Ints, Ints]:
    """Return the first and one past the last (N, 3) of the sorted azimuths within half an angle of each direction.

    There are three parts, as a span can go over the end of the circle; all but one are empty for a whole circle.
    """
    turns = np.array([-2 * np.pi, 0.0, 2 * np.pi])
    low, high = ((middle + sign * half)[:, None] + turns for sign in (-1, 1))
    first, last = np.searchsorted(azimuth, low), np.searchsorted(azimuth, high)
    around = half >= np.pi
    first[around], last[around] = 0, [len(azimuth), 0, 0]
    return first, last


@njit(cache=True, nogil=True, error_model="numpy")
def _count(shapes: Floats, origin: Floats, rays: Floats, first: Ints, last: Ints, on: Ints, through: Ints) -> None:
    """Add the rays that end in each box to `on`, and those that cross its core and go on to `through`.

    Args:
        shapes: (N, 8) middle, half of length, width and height, yaw, and m by which the box may be off its place.
        origin: (3,) of the rays.
        rays: (P, 3) from the origin to what they hit.
        first: (N, K) first rays to look at, in K parts.
        last: (N, K) one past the last.
        on: (N,) counts.
        through: (N,) counts.
    """
    for k in range(len(shapes)):
        cos, sin = math.cos(shapes[k, 6]), math.sin(shapes[k, 6])
        start = _turned(origin[0] - shapes[k, 0], origin[1] - shapes[k, 1], origin[2] - shapes[k, 2], cos, sin)
        half, off_m = shapes[k, 3:6], shapes[k, 7]
        low = -half[2] + min(_GROUND_M, half[2])
        top = (half[0] * _CORE, half[1] * _CORE, -half[2] + 2 * half[2] * _CORE)
        bottom = (-half[0] * _CORE, -half[1] * _CORE, low)
        for part in range(first.shape[1]):
            for row in range(first[k, part], last[k, part]):
                way = _turned(rays[row, 0], rays[row, 1], rays[row, 2], cos, sin)
                x, y, z = start[0] + way[0], start[1] + way[1], start[2] + way[2]
                if abs(x) <= half[0] + off_m and abs(y) <= half[1] + off_m and low <= z <= half[2] + off_m:
                    on[k] += 1
                elif _crosses(start, way, bottom, top):
                    through[k] += 1


@njit(cache=True, nogil=True)
def _turned(x: float, y: float, z: float, cos: float, sin: float) -> tuple[float, float, float]:
    """Return a vector of the base frame along the axes of a box."""
    return x * cos + y * sin, y * cos - x * sin, z


@njit(cache=True, nogil=True, error_model="numpy")
def _crosses(start: _Vector, way: _Vector, bottom: _Vector, top: _Vector) -> bool:
    """Return whether a ray that begins outside enters the block between two corners, and leaves it before its end."""
    enters, leaves = -math.inf, math.inf
    for axis in range(3):
        one, other = (bottom[axis] - start[axis]) / way[axis], (top[axis] - start[axis]) / way[axis]
        if one == one and other == other:  # NaN: along a side, which says nothing
            enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return 0 < enters < leaves < 1
