"""The pictures of several agents as tensors, each with the place of its lines of sight on its agent's canvas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.camera.measured_depth import measured_depth
from coopsim.nn.camera.sight import STRIDE_PX, cells_of, sight_of
from coopsim.types import BevGrid, CameraCalibration


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
        geometry: (M, 4, h, w), see `Sight`.
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
    sight, rgb = sight_of(picture.calibration), _filled_up(picture.rgb)
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
