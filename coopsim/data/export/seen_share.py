"""Visibility of an object to an agent's LiDARs: the share of the rays through its box that come back from it.

Data sets grade occlusion by hand or by pixels. To cast every ray twice, with and without what hides an object, would
take longer than the simulation (`coopsim.sensors.visibility`). Here rays are counted without the scene. A body fills
only a part of its box: half of the free objects have shares from 0.6 to 0.85, and a share of 0.73 in the middle.
"""

from __future__ import annotations

import numpy as np

from coopsim.data.export.export_frame import ExportFrame
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, LidarMounting

FREE_SHARE = 0.73
"""Median share of objects that nothing hides, in the crossing."""

LEAST_FREE, LEAST_PARTLY = 0.5, 0.2
"""Shares from which an object counts as free, and as partly hidden; below them it is largely hidden."""


def seen_shares(frame: ExportFrame, column: int) -> Floats:
    """Return the share (N,) in [0, 1] of the rays through each object's box that return from it."""
    agent = frame.agents[column]
    returns, shares = frame.returns[:, column], np.zeros(len(frame.objects))
    seen = returns > 0
    boxes = frame.objects.boxes[seen].transform(agent.world_SE3_base.inverse())
    rays = np.zeros(len(boxes), np.int64)
    for scan in agent.lidars.values():
        rays += rays_through(boxes, scan.mounting)
    shares[seen] = np.minimum(returns[seen] / np.maximum(rays, 1), 1.0)
    return shares


def occlusion_levels(frame: ExportFrame, column: int) -> Ints:
    """Return KITTI's level (N,) of each object: 0 free, 1 partly hidden, 2 largely hidden."""
    shares = seen_shares(frame, column)
    levels: Ints = (shares < LEAST_FREE).astype(np.int64) + (shares < LEAST_PARTLY)
    return levels


def rays_through(boxes: Boxes3D, mounting: LidarMounting) -> Ints:
    """Count the rays of a revolution through each box (N,), which are in the agent's base frame, within the range."""
    lidar_SE3_base = mounting.base_SE3_lidar.inverse()
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    turn = np.zeros((len(boxes), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cos, -sin, sin, cos, 1.0
    axes = np.ascontiguousarray(np.einsum("ij,njk->nik", lidar_SE3_base.rotation, turn))
    center = np.ascontiguousarray(lidar_SE3_base.apply(boxes.center))
    half = np.ascontiguousarray(boxes.size) / 2
    counts: Ints = _count(center, axes, half, np.sort(mounting.elevation_rad), mounting.columns, mounting.max_range_m)
    return counts


@njit(cache=True, nogil=True)
def _count(center: Floats, axes: Floats, half: Floats, elevation: Floats, columns: int, farthest_m: float) -> Ints:
    """Count rays from the origin through boxes with middles (N, 3), axes as columns (N, 3, 3) and half sizes (N, 3)."""
    counts = np.zeros(len(center), np.int64)
    step = 2 * np.pi / columns
    cos, sin = np.cos(np.arange(columns) * step), np.sin(np.arange(columns) * step)
    for n in range(len(center)):
        c, a, h = center[n], axes[n], half[n]
        away, radius = np.sqrt((c * c).sum()), np.sqrt((h * h).sum())
        level = np.hypot(c[0], c[1])
        if away - radius > farthest_m:
            continue
        wide = np.arcsin(radius / level) if level > radius else np.pi
        high = np.arcsin(radius / away) if away > radius else np.pi
        middle, up = np.arctan2(c[1], c[0]), np.arctan2(c[2], level)
        first = int(np.ceil((middle - wide) / step))
        last = min(int(np.floor((middle + wide) / step)), first + columns - 1)
        for beam in range(len(elevation)):
            if abs(elevation[beam] - up) > high:
                continue
            z, flat = np.sin(elevation[beam]), np.cos(elevation[beam])
            for k in range(first, last + 1):
                x, y = flat * cos[k % columns], flat * sin[k % columns]
                near, far = 0.0, farthest_m
                for axis in range(3):
                    along = a[0, axis] * x + a[1, axis] * y + a[2, axis] * z
                    place = a[0, axis] * c[0] + a[1, axis] * c[1] + a[2, axis] * c[2]
                    if abs(along) < 1e-12:
                        if abs(place) > h[axis]:
                            near = np.inf
                        continue
                    one, two = (place - h[axis]) / along, (place + h[axis]) / along
                    near, far = max(near, min(one, two)), min(far, max(one, two))
                if near <= far:
                    counts[n] += 1
    return counts
