"""Pictures of several agents as tensors, with the rays and measured depths of their cells on each agent's canvas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.intrinsics import undistort
from coopsim.sensors.camera.projection import project
from coopsim.types import BevGrid, CameraCalibration


@dataclass(frozen=True, slots=True, eq=False)
class SeenPicture:
    """Picture (H, W, 3) uint8, and the calibration of its camera in the agent's base frame."""

    rgb: NDArray[np.uint8]
    calibration: CameraCalibration


@dataclass(frozen=True, slots=True, eq=False)
class PictureView:
    """Pictures of one agent, and the map on which they are laid.

    Attributes:
        pictures: any number of pictures.
        map_SE2_base: (3,) x m, y m, yaw rad: pose of the agent's base frame in the frame of the map.
        grid: cells of the canvas on which the pictures are laid.
        mirrored: y becomes -y, left and right of each picture change places.
        points_m: (P, 3) in the base frame, whose depths in the pictures are measured; None: nothing is measured.
    """

    pictures: Sequence[SeenPicture]
    map_SE2_base: Floats
    grid: BevGrid
    mirrored: bool = False
    points_m: NDArray[np.floating] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CameraViews:
    """M pictures of one size, in cells of their features, as tensors.

    Attributes:
        rgb: (M, 3, H, W) uint8, of whole cells.
        geometry: (M, 4, h, w), see `CellRays`.
        start: (M, 3) the camera's place: column and row in cells of the agent's canvas, and height in m.
        ray: (M, 3, h, w) the same per metre of depth.
        measured_m: (M, h, w) depth of the nearest point in each cell; 0: there is none.
        agent: (M,) number of the agent.
    """

    rgb: Tensor
    geometry: Tensor
    start: Tensor
    ray: Tensor
    measured_m: Tensor
    agent: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class PictureBatch:
    """The pictures of A agents, in groups of one size, for canvases of one shape (H, W)."""

    views: tuple[CameraViews, ...]
    agents: int
    shape: tuple[int, int]

    def to(self, device: torch.device | str) -> PictureBatch:
        """Return the batch on another device."""
        moved = (
            CameraViews(*(getattr(each, name).to(device) for name in CameraViews.__slots__)) for each in self.views
        )
        return PictureBatch(tuple(moved), self.agents, self.shape)


def collate_pictures(agents: Sequence[PictureView]) -> PictureBatch:
    """Join the pictures of agents whose canvases have one shape; groups are as `by_size` has them.

    Raises:
        InvalidValueError: there is no agent, canvases have different shapes, a picture is not of its camera's size or
            not uint8, or a lens folds its picture over.
    """
    shapes = {agent.grid.shape for agent in agents}
    if len(shapes) != 1:
        raise InvalidValueError(f"a batch takes agents with canvases of one shape, got {sorted(shapes) or 'no agent'}")
    (shape,) = shapes
    views = tuple(_joined(agents, places) for places in by_size(agents))
    return PictureBatch(views, len(agents), shape)


def by_size(agents: Sequence[PictureView]) -> list[list[tuple[int, int]]]:
    """Return the pictures of agents in groups of one size, each picture by the numbers of its agent and among its own.

    Raises:
        InvalidValueError: a picture is not of its camera's size, or not uint8.
    """
    groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for number, agent in enumerate(agents):
        for k, picture in enumerate(agent.pictures):
            size = picture.calibration.size
            if picture.rgb.shape != (*size, 3) or picture.rgb.dtype != np.uint8:
                raise InvalidValueError(
                    f"a picture must be (H, W, 3) uint8 of its camera's size {tuple(size)}, "
                    f"got {picture.rgb.shape} {picture.rgb.dtype}"
                )
            groups.setdefault(cells_of(size), []).append((number, k))
    return list(groups.values())


def _on_canvas(picture: SeenPicture, agent: PictureView) -> tuple[NDArray[Any], ...]:
    """Return a picture with geometry, start, ray and measured depth of its cells, for an agent's canvas."""
    sight, rgb = cell_rays(picture.calibration), _filled_up(picture.rgb)
    x, y, yaw = agent.map_SE2_base
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    start = np.append(turn @ sight.start_m[:2] + [x, y], sight.start_m[2])
    ray = np.concatenate([np.tensordot(turn, sight.ray[:2], 1), sight.ray[2:]])
    geometry, grid = sight.geometry, agent.grid
    measured_m = np.zeros(geometry.shape[1:], np.float32)
    if agent.points_m is not None:
        measured_m = measured_depth(picture.calibration, agent.points_m)
    if agent.mirrored:
        start[1] *= -1
        ray[1] *= -1
        rgb, ray, geometry, measured_m = rgb[:, ::-1], ray[:, :, ::-1], geometry[:, :, ::-1], measured_m[:, ::-1]
    start[:2] = (start[:2] - [grid.x_m[0], grid.y_m[0]]) / grid.cell_m
    ray[:2] /= grid.cell_m
    return rgb, geometry, start, ray, measured_m


def _filled_up(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with black pixels on the right and below, until all its cells are whole."""
    rows, columns = (STRIDE_PX * cells for cells in cells_of(rgb.shape[:2]))
    more = (rows - rgb.shape[0], columns - rgb.shape[1])
    return np.pad(rgb, ((0, more[0]), (0, more[1]), (0, 0))) if any(more) else rgb


def _joined(agents: Sequence[PictureView], places: Sequence[tuple[int, int]]) -> CameraViews:
    each = [_on_canvas(agents[number].pictures[k], agents[number]) for number, k in places]
    rgb, geometry, start, ray, measured_m = (np.stack(column) for column in zip(*each, strict=True))
    return CameraViews(
        torch.from_numpy(rgb).permute(0, 3, 1, 2),
        torch.from_numpy(geometry),
        torch.from_numpy(start).float(),
        torch.from_numpy(ray).float(),
        torch.from_numpy(measured_m),
        torch.tensor([number for number, _ in places]),
    )


STRIDE_PX = 8
"""Edge of a cell of a picture's features, in pixels."""

GEOMETRY = 4
"""Numbers that a network is told about each cell, see `CellRays`."""

_REMEMBERED = 256
_LOWEST_M = 0.05  # height over the ground below which a camera is taken to be at it


@dataclass(frozen=True, slots=True, eq=False)
class CellRays:
    """Rays through one camera's cells, in its agent's base frame, whose z = 0 is the ground.

    Attributes:
        start_m: (3,) the camera.
        ray: (3, h, w) float32, through the middle of each cell: an object at a depth of d m along the optical axis is
            at start_m + d * ray.
        geometry: (4, h, w) float32: inverse depth of the nearest ground in the cell, in 1/dam (0: above the horizon);
            elevation of the ray in rad; logarithm of cells per radian, less 3; logarithm of the camera's height in m.
    """

    start_m: Floats
    ray: NDArray[np.float32]
    geometry: NDArray[np.float32]


def cell_rays(calibration: CameraCalibration) -> CellRays:
    """Return the lines of sight of a camera; those of the last calibrations are remembered.

    Raises:
        InvalidValueError: the distortion folds the picture over.
    """
    pose = calibration.base_SE3_camera
    numbers = (calibration.matrix, calibration.distortion, pose.rotation, pose.translation)
    return _cell_rays(tuple(calibration.size), *(np.ascontiguousarray(each, np.float64).tobytes() for each in numbers))


@lru_cache(_REMEMBERED)
def _cell_rays(size: tuple[int, int], matrix: bytes, distortion: bytes, rotation: bytes, start: bytes) -> CellRays:
    lens, turn, start_m = (
        np.frombuffer(matrix).reshape(3, 3),
        np.frombuffer(rotation).reshape(3, 3),
        np.frombuffer(start),
    )
    rows, columns = cells_of(size)
    folds = np.frombuffer(distortion)

    def rays(across: float, down: float) -> Floats:
        """Return the rays (3, h, w) through a place in each cell, in pixels from its first one."""
        u = np.minimum(STRIDE_PX * np.arange(columns) + across, size[1] - 0.5)
        v = np.minimum(STRIDE_PX * np.arange(rows) + down, size[0] - 0.5)
        x, y = np.meshgrid((u - lens[0, 2]) / lens[0, 0], (v - lens[1, 2]) / lens[1, 1])
        seen = np.column_stack([x.ravel(), y.ravel()])
        if folds.any():
            k1, k2, p1, p2, k3 = folds.tolist()
            seen = undistort(seen, (k1, k2, p1, p2, k3))
        directions: Floats = (np.column_stack([seen, np.ones(len(seen))]) @ turn.T).T.reshape(3, rows, columns)
        return directions

    last = STRIDE_PX - 1
    ray = rays(last / 2, last / 2)
    lowest = np.min([rays(across, down)[2] for across in (0, last) for down in (0, last)], axis=0)
    above_m = max(float(start_m[2]), _LOWEST_M)
    elevation = np.arctan2(ray[2], np.hypot(ray[0], ray[1]))
    ground = 10.0 * np.maximum(-lowest, 0.0) / above_m
    fine = np.full_like(elevation, np.log(lens[0, 0] / STRIDE_PX) - 3.0)
    high = np.full_like(elevation, np.log(above_m))
    return CellRays(start_m, ray.astype(np.float32), np.stack([ground, elevation, fine, high]).astype(np.float32))


def cells_of(size: tuple[int, int]) -> tuple[int, int]:
    """Return rows and columns of the features of a picture of this height and width."""
    return -(-size[0] // STRIDE_PX), -(-size[1] // STRIDE_PX)


def measured_depth(calibration: CameraCalibration, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the depth of the nearest point (P, 3), in the agent's base frame, in each cell of a picture, (h, w) m; 0
    without.

    Raises:
        InvalidValueError: the points are of another shape, or the distortion folds the picture over.
    """
    rows, columns = cells_of(calibration.size)
    found = project(calibration, points_m.astype(np.float64))
    place = np.floor((found.place_px[found.inside] + 0.5) / STRIDE_PX).astype(np.int64)
    cell = np.clip(place[:, 1], 0, rows - 1) * columns + np.clip(place[:, 0], 0, columns - 1)
    nearest = np.full(rows * columns, np.inf)
    np.minimum.at(nearest, cell, found.depth_m[found.inside])
    return np.where(np.isfinite(nearest), nearest, 0.0).astype(np.float32).reshape(rows, columns)
