"""Where the cells of a picture's features look: lines in space, for any lens and mounting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.distortion import undistort
from coopsim.types import BevGrid, CameraCalibration

STRIDE_PX = 8
"""Edge of a cell of a picture's features, in pixels."""

GEOMETRY = 4
"""Numbers that a network is told about each cell, see `Sight`."""

_REMEMBERED = 256
_LOWEST_M = 0.05  # height over the ground below which a camera is taken to be at it


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """The lines of sight of one camera's cells, in its agent's base frame, whose z = 0 is the ground.

    Attributes:
        start_m: (3,) the camera.
        ray: (3, h, w) float32, from it through the middle of each cell; as long as the optical axis per metre of depth.
        geometry: (4, h, w) float32: inverse depth of the nearest ground in the cell, in 1/dam (0: above the horizon),
            elevation of the ray in rad, cells per radian as a logarithm, and height of the camera as a logarithm.
    """

    start_m: Floats
    ray: NDArray[np.float32]
    geometry: NDArray[np.float32]


def sight_of(calibration: CameraCalibration) -> Sight:
    """Return the lines of sight of a camera; those of the last calibrations are remembered.

    Raises:
        InvalidValueError: the distortion folds the picture over.
    """
    pose = calibration.base_SE3_camera
    numbers = (calibration.matrix, calibration.distortion, pose.rotation, pose.translation)
    return _sight(tuple(calibration.size), *(np.ascontiguousarray(each, np.float64).tobytes() for each in numbers))


@lru_cache(_REMEMBERED)
def _sight(size: tuple[int, int], matrix: bytes, distortion: bytes, rotation: bytes, start: bytes) -> Sight:
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
    return Sight(start_m, ray.astype(np.float32), np.stack([ground, elevation, fine, high]).astype(np.float32))


def cells_of(size: tuple[int, int]) -> tuple[int, int]:
    """Return rows and columns of the features of a picture of this height and width."""
    return -(-size[0] // STRIDE_PX), -(-size[1] // STRIDE_PX)


@dataclass(frozen=True, slots=True, eq=False)
class SeenPicture:
    """A picture and how it was taken.

    Attributes:
        rgb: (H, W, 3) uint8.
        calibration: of the camera, with its pose in the agent's base frame.
    """

    rgb: NDArray[np.uint8]
    calibration: CameraCalibration


@dataclass(frozen=True, slots=True, eq=False)
class PictureView:
    """All pictures of one agent, and the map that is made of them.

    Attributes:
        pictures: none is accepted: nothing is seen then.
        map_SE2_base: (3,) x m, y m, yaw rad: pose of the agent's base frame in the frame of the map.
        grid: cells of the canvas on which the pictures are laid.
        mirrored: the map is seen in a mirror: y becomes -y, left and right of each picture change places.
    """

    pictures: Sequence[SeenPicture]
    map_SE2_base: Floats
    grid: BevGrid
    mirrored: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CameraViews:
    """M pictures of one size as tensors.

    Attributes:
        rgb: (M, 3, H, W) uint8, of whole cells.
        geometry: (M, 4, h, w), see `Sight`.
        start: (M, 3) the camera's place: column and row in cells of the agent's canvas, and height in m.
        ray: (M, 3, h, w) the same per metre of depth.
        agent: (M,) number of the agent.
    """

    rgb: Tensor
    geometry: Tensor
    start: Tensor
    ray: Tensor
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
        InvalidValueError: there is no agent, canvases have different shapes, or a picture has not its camera's size.
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
        InvalidValueError: a picture has not its camera's size.
    """
    groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for number, agent in enumerate(agents):
        for k, picture in enumerate(agent.pictures):
            size = picture.calibration.size
            if picture.rgb.shape != (*size, 3):
                raise InvalidValueError(
                    f"a picture must be (H, W, 3) of its camera's size {tuple(size)}, got {picture.rgb.shape}"
                )
            groups.setdefault(cells_of(size), []).append((number, k))
    return list(groups.values())


def _on_canvas(
    picture: SeenPicture, agent: PictureView
) -> tuple[NDArray[np.uint8], NDArray[np.float32], Floats, Floats]:
    """Return a picture with geometry, start and ray of its cells on an agent's canvas."""
    sight, rgb = sight_of(picture.calibration), _filled_up(picture.rgb)
    x, y, yaw = agent.map_SE2_base
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    start = np.append(turn @ sight.start_m[:2] + [x, y], sight.start_m[2])
    ray = np.concatenate([np.tensordot(turn, sight.ray[:2], 1), sight.ray[2:]])
    geometry, grid = sight.geometry, agent.grid
    if agent.mirrored:
        start[1] *= -1
        ray[1] *= -1
        rgb, ray, geometry = rgb[:, ::-1], ray[:, :, ::-1], geometry[:, :, ::-1]
    start[:2] = (start[:2] - [grid.x_m[0], grid.y_m[0]]) / grid.cell_m
    ray[:2] /= grid.cell_m
    return rgb, geometry, start, ray


def _filled_up(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with black pixels on the right and below, until all its cells are whole."""
    rows, columns = (STRIDE_PX * cells for cells in cells_of(rgb.shape[:2]))
    more = (rows - rgb.shape[0], columns - rgb.shape[1])
    return np.pad(rgb, ((0, more[0]), (0, more[1]), (0, 0))) if any(more) else rgb


def _joined(agents: Sequence[PictureView], places: Sequence[tuple[int, int]]) -> CameraViews:
    each = [_on_canvas(agents[number].pictures[k], agents[number]) for number, k in places]
    rgb, geometry, start, ray = (np.stack(column) for column in zip(*each, strict=True))
    return CameraViews(
        torch.from_numpy(rgb).permute(0, 3, 1, 2),
        torch.from_numpy(geometry),
        torch.from_numpy(start).float(),
        torch.from_numpy(ray).float(),
        torch.tensor([number for number, _ in places]),
    )
