"""Rays of a receiver's LiDARs: which claimed objects they hit, and which they go through."""

from __future__ import annotations

import numpy as np

from coopsim.defenses.defense import Claim, Reception
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints, Mask

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
        for origin, azimuth, rays in self._sweeps:
            for k in range(len(boxes)):
                near = rays[_between(azimuth, *_angles(boxes, k, float(off_m[k]), origin))]
                hits, crosses = _hits_and_crosses(boxes, k, float(off_m[k]), origin, near)
                on[k] += hits.sum()
                through[k] += crosses.sum()
        return on, through


def _angles(boxes: Boxes3D, k: int, off_m: float, origin: Floats) -> tuple[float, float]:
    """Return direction of a box from a LiDAR, and the half angle under which it is seen; pi where it is too near."""
    to = boxes.center[k, :2] - origin[:2]
    radius, away = float(np.hypot(*boxes.size[k, :2])) / 2 + off_m, float(np.hypot(*to))
    return float(np.arctan2(to[1], to[0])), np.pi if away <= radius else float(np.arcsin(radius / away))


def _between(azimuth: Floats, middle: float, half: float) -> Ints:
    """Return the numbers of the sorted azimuths within a half angle of a direction."""
    if half >= np.pi:
        return np.arange(len(azimuth))
    ends = [(middle - half + turn, middle + half + turn) for turn in (-2 * np.pi, 0.0, 2 * np.pi)]
    return np.concatenate([np.arange(*np.searchsorted(azimuth, both)) for both in ends])


def _hits_and_crosses(boxes: Boxes3D, k: int, off_m: float, origin: Floats, rays: Floats) -> tuple[Mask, Mask]:
    """Return the masks of rays (P, 3) from `origin` that end in a box, and of those that cross its core and go on."""
    cos, sin = np.cos(boxes.yaw[k]), np.sin(boxes.yaw[k])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])  # from the box's axes to the base frame's
    start, way, half = (origin - boxes.center[k]) @ turn, rays @ turn, boxes.size[k] / 2
    low = -half[2] + min(_GROUND_M, half[2])
    end = start + way
    wide, upper = half[:2] + off_m, half[2] + off_m
    hits: Mask = (np.abs(end[:, :2]) <= wide).all(axis=1) & (end[:, 2] >= low) & (end[:, 2] <= upper)
    top = np.array([*(half[:2] * _CORE), -half[2] + 2 * half[2] * _CORE])
    bottom = np.array([*(-half[:2] * _CORE), low])
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (bottom - start) / way, (top - start) / way
    enters, leaves = np.nanmax(np.minimum(one, other), axis=1), np.nanmin(np.maximum(one, other), axis=1)
    crosses: Mask = (enters > 0) & (enters < leaves) & (leaves < 1)
    return hits, crosses & ~hits
