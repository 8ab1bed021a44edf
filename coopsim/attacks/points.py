"""Attacks on the points of a sweep, as the owner of a compromised sensor can: `point_ghost` and `point_removal`.

They reach all messages that are made of points: points, features and queries.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from coopsim.attacks.ghost import PlacedClaim
from coopsim.attacks.objects import ObjectLie
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.attack import ATTACKS, AttackerView
from coopsim.support.checks import require_non_negative
from coopsim.types import Ints, LidarMounting, Mask, Sweep
from coopsim.types.taxonomy import ObjectClass

_RANGE_NOISE_M = 0.02
"""Standard deviation of a made-up range: that of `LidarConfig`, from the HDL-32E's manual."""


@ATTACKS.register("point_ghost")
@dataclass(kw_only=True)
class PointGhost(PlacedClaim):
    """Cast a model into the own sweep at a place before the victim, as Zhang et al. (USENIX Security 2024) spoof.

    Each of the sensor's rays that would hit the model ends on it, unless the real return is nearer. So the points are
    those that a real object would give, shadow included. It knows the poses in messages, and costs next to no bytes.
    """

    def sense(self, view: AttackerView, sweeps: Mapping[str, Sweep]) -> Mapping[str, Sweep]:
        placed = self.placed(view)
        if placed is None:
            return sweeps
        number, boxes, _ = placed
        view.claim(np.array([number]), boxes)
        cast = {name: self._cast(view, sweep, view.spec.lidars[name], boxes) for name, sweep in sweeps.items()}
        return {name: cast.get(name, sweep) for name, sweep in sweeps.items()}

    def _cast(self, view: AttackerView, sweep: Sweep, mounting: LidarMounting, boxes: Boxes3D) -> Sweep:
        range_m, intensity = _hits(mounting, boxes, self.label)
        beam, column = _rays_of(sweep, mounting)
        inside = (beam >= 0) & (beam < len(range_m))
        own_m = np.linalg.norm(sweep.points - mounting.base_SE3_lidar.translation, axis=1)
        hidden = np.zeros(len(sweep), np.bool_)
        hidden[inside] = own_m[inside] > range_m[beam[inside], column[inside]]
        nearest_m = np.full(range_m.shape, np.inf)
        np.minimum.at(nearest_m, (beam[inside], column[inside]), own_m[inside])
        rows, columns = np.nonzero(np.isfinite(range_m) & (range_m < nearest_m))
        ranges = range_m[rows, columns] + _RANGE_NOISE_M * view.rng.standard_normal(len(rows))
        points = mounting.base_SE3_lidar.apply(_directions(mounting)[rows, columns] * ranges[:, None])
        return _joined(_kept(sweep, ~hidden), points, intensity[rows, columns], rows, mounting)


@ATTACKS.register("point_removal")
@dataclass(kw_only=True)
class PointRemoval(ObjectLie):
    """Delete the points of the objects that the agent detects; the rays return nothing.

    Attributes:
        margin_m: distance around each box in which points are deleted, too.
    """

    margin_m: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(margin_m=self.margin_m)

    def sense(self, view: AttackerView, sweeps: Mapping[str, Sweep]) -> Mapping[str, Sweep]:
        boxes = view.observation.detections.boxes
        boxes = boxes[self.chosen(view, boxes)]
        if not len(boxes):
            return sweeps
        view.deny(boxes)
        return {name: _kept(sweep, ~_inside(sweep.points, boxes, self.margin_m)) for name, sweep in sweeps.items()}


def _inside(points: Any, boxes: Boxes3D, margin_m: float) -> Mask:
    """Return the mask (N,) of points in any of the boxes, each made larger by the margin, except downwards."""
    inside = np.zeros(len(points), np.bool_)
    for center, size, yaw in zip(boxes.center, boxes.size, boxes.yaw, strict=True):
        x, y, z = (points - center).T
        along, across = x * np.cos(yaw) + y * np.sin(yaw), y * np.cos(yaw) - x * np.sin(yaw)
        half = size / 2 + margin_m
        inside |= (np.abs(along) <= half[0]) & (np.abs(across) <= half[1]) & (z <= half[2]) & (z >= -size[2] / 2 + 0.1)
    return inside


def _kept(sweep: Sweep, mask: Mask) -> Sweep:
    return Sweep(sweep.points[mask], sweep.intensity[mask], sweep.beam[mask])


def _joined(sweep: Sweep, points: Floats, intensity: Floats, beam: Ints, mounting: LidarMounting) -> Sweep:
    """Return the points of both in the order in which sweeps have them: by beam, then by column."""
    whole = Sweep(
        np.concatenate([sweep.points, points.astype(np.float32)]),
        np.concatenate([sweep.intensity, intensity.astype(np.float32)]),
        np.concatenate([sweep.beam, beam]),
    )
    rows, columns = _rays_of(whole, mounting)
    order = np.lexsort((columns, rows))
    return Sweep(whole.points[order], whole.intensity[order], whole.beam[order])


def _directions(mounting: LidarMounting) -> Floats:
    """Return the directions (B, C, 3) of all rays in the LiDAR's frame."""
    azimuth = np.arange(mounting.columns) * (2 * np.pi / mounting.columns)
    elevation = mounting.elevation_rad[:, None]
    flat = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (len(mounting.elevation_rad), mounting.columns))
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)


def _rays_of(sweep: Sweep, mounting: LidarMounting) -> tuple[Ints, Ints]:
    """Return beam and column (N,) of the ray behind each point."""
    local = mounting.base_SE3_lidar.inverse().apply(sweep.points)
    azimuth = np.arctan2(local[:, 1], local[:, 0]) % (2 * np.pi)
    return sweep.beam, np.rint(azimuth / (2 * np.pi / mounting.columns)).astype(np.int64) % mounting.columns


def _hits(mounting: LidarMounting, boxes: Boxes3D, label: str) -> tuple[Floats, Floats]:
    """Return range (m, inf: none) and intensity (B, C) of the rays' returns from a model in the box (1)."""
    from coopsim.sensors.lidar.ray_grid import RayGrid
    from coopsim.sensors.scene import Triangles

    vertices, faces, reflectivity = _model(label)
    base_SE3_model = SE3.from_xyz_yaw(boxes.center[0], float(boxes.yaw[0]))
    placed = base_SE3_model.apply(vertices * boxes.size[0])
    count = len(faces)
    triangles = Triangles(placed, faces, np.ones(count, np.int64), reflectivity, np.zeros((count, 3), np.uint8))
    grid = RayGrid(mounting.elevation_rad, np.zeros(len(mounting.elevation_rad)), mounting.columns)
    hits = grid.cast(triangles, mounting.base_SE3_lidar)
    range_m = np.where(hits.range_m <= mounting.max_range_m, hits.range_m.astype(np.float64), math.inf)
    return range_m, np.where(hits.face >= 0, reflectivity[hits.face] * hits.cosine, 0.0)


@cache
def _model(label: str) -> tuple[Floats, Ints, Floats]:
    """Return the mesh of a class: vertices (V, 3) of a box of unit size, faces (F, 3) and their reflectivity (F,)."""
    from coopsim.world.models.catalogue import make_models, models_of

    models = make_models()
    model = models[int(models_of(models, ObjectClass[label.upper()])[0])]
    return model.vertices / model.size_m, model.faces, np.minimum(model.reflectivity, 1.0)
