"""Warp: maps of senders, resampled on the receiver's grid.

A receiver samples, so it needs the way from its own cells into the sender's map, `source_SE2_target`. With p the centre
of a target cell, R and t the rotation and translation of that transform, c, W, H and k a grid's centre, cells and cell
width, the place in the source map is R p + t, and in the coordinates of `grid_sample` with `align_corners=False`, in
which a map reaches from -1 to 1,

    theta[:, :2] = diag(2/(w k_s), 2/(h k_s)) R diag(W k_t/2, H k_t/2)
    theta[:, 2]  = (2/(w k_s), 2/(h k_s)) (R c_t + t - c_s).
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.types import BevGrid

_SLACK_CELLS = 1e-4
"""Positions this close to a cell's centre, or beyond the outermost centres, count as on it: rounding, not distance."""
_LEAST_YAW_RAD = 1e-7
"""Smaller turns move no cell of a map of kilometres by a millimetre: they are computed as shifts."""
_LEAST_PRESENT = 0.25
"""Share of present cells from which a cell is valid. A lone cell has this much of one target cell, however shifted."""


def warp(
    maps: Tensor, source: BevGrid, target: BevGrid, source_SE2_target: ArrayLike, present: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Resample maps of S senders on one grid, bilinearly.

    A target cell is valid if its centre lies between the outermost cell centres of the source map, and at least a
    quarter of its bilinear weights falls on cells that are present. Its value is the weighted mean of these. Values of
    other cells are 0. A shift by whole cells copies values exactly. Gradients reach `maps`.

    Args:
        maps: (S, C, h, w), floating.
        source: the grid of all `maps`, each in its own sender's frame.
        target: the grid of the result, in the receiver's frame. Both may have any size, place and cell width; nothing
            is averaged over where the target's cells are wider.
        source_SE2_target: (S, 3) x m, y m, yaw rad of the receiver's frame in the sender's: maps the receiver's
            coordinates into the sender's.
        present: (S, h, w) bool, the cells that were sent; None: all.

    Returns:
        The warped maps (S, C, H, W), in the numbers of `maps`, and the valid cells (S, H, W), bool.

    Raises:
        InvalidValueError: shapes do not fit the grid or each other, or a pose is not finite.
    """
    poses = np.asarray(source_SE2_target, dtype=np.float64).reshape(-1, 3)
    _require(maps, source, poses, present)
    if present is not None:
        inside = present[:, None].to(maps.dtype)
        maps = torch.cat([maps * inside, inside], 1)
    warped = _zeros_like(maps, target)
    valid = torch.zeros((len(maps), *target.shape), dtype=torch.bool, device=maps.device)
    for sender, pose in enumerate(poses):
        rows, columns = _overlap(source, target, pose)
        if rows.start < rows.stop and columns.start < columns.stop:
            part = _part(target, rows, columns)
            one = _shifted if abs(pose[2]) < _LEAST_YAW_RAD and source.cell_m == target.cell_m else _sampled
            values, inside = one(maps[sender : sender + 1], source, part, pose)
            warped[sender, :, rows, columns], valid[sender, rows, columns] = values, inside
    return (warped, valid) if present is None else _mean_of_present(warped, valid)


def placing(target: BevGrid, source_SE2_target: ArrayLike, error: ArrayLike) -> tuple[Tensor, Tensor]:
    """Return how uncertain the place of each warped cell is and how far from its sender it lies, both (S, H, W) m.

    An error of the heading moves a cell the more, the farther away it is: sqrt(e_m^2 + (e_rad r)^2) at the distance r.

    Args:
        target: the grid of the warped maps.
        source_SE2_target: (S, 3) the receiver's frame in each sender's, as in `warp`.
        error: (S, 2) standard deviations of the place (m) and the heading (rad) of one frame in the other.
    """
    poses = np.asarray(source_SE2_target, dtype=np.float64).reshape(-1, 3)
    errors = np.asarray(error, dtype=np.float64).reshape(-1, 2)
    rows, columns = target.shape
    x = target.x_m[0] + (np.arange(columns) + 0.5) * target.cell_m
    y = target.y_m[0] + (np.arange(rows) + 0.5) * target.cell_m
    # The sender's place in the receiver's frame is -R^T t.
    sender = np.array([-_rotation(yaw).T @ [dx, dy] for dx, dy, yaw in poses]).reshape(-1, 2)
    range_m = np.hypot(x[None, None] - sender[:, 0, None, None], y[None, :, None] - sender[:, 1, None, None])
    error_m = np.hypot(errors[:, 0, None, None], errors[:, 1, None, None] * range_m)
    return torch.from_numpy(error_m).float(), torch.from_numpy(range_m).float()


def _zeros_like(maps: Tensor, target: BevGrid) -> Tensor:
    """Return zeros (S, C, H, W) that lie in memory as `maps` do: copies between layouts cost more than a warp."""
    senders, channels = maps.shape[:2]
    if channels > 1 and maps.stride(1) == 1:
        return maps.new_zeros((senders, *target.shape, channels)).permute(0, 3, 1, 2)
    return maps.new_zeros((senders, channels, *target.shape))


def _mean_of_present(warped: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Divide by the last channel, the weight of cells that are present."""
    values, weight = warped[:, :-1], warped[:, -1]
    valid = valid & (weight >= _LEAST_PRESENT - _SLACK_CELLS)
    return torch.where(valid[:, None], values / weight.clamp_min(_LEAST_PRESENT / 2)[:, None], 0.0), valid


def _shifted(image: Tensor, source: BevGrid, part: BevGrid, pose: np.ndarray) -> tuple[Tensor, Tensor]:
    """Warp without rotation: as `_sampled`, by two blends of slices. `part` lies between the outermost centres."""
    for dim, offset, cells in (
        (-1, (part.x_m[0] + pose[0] - source.x_m[0]) / source.cell_m, part.shape[1]),
        (-2, (part.y_m[0] + pose[1] - source.y_m[0]) / source.cell_m, part.shape[0]),
    ):
        first = round(offset) if abs(offset - round(offset)) < _SLACK_CELLS else math.floor(offset)
        share = offset - first
        near = image.narrow(dim, first, cells)
        image = near if abs(share) < _SLACK_CELLS else near.lerp(image.narrow(dim, first + 1, cells), share)
    return image[0], torch.ones(part.shape, dtype=torch.bool, device=image.device)


def _sampled(image: Tensor, source: BevGrid, part: BevGrid, pose: np.ndarray) -> tuple[Tensor, Tensor]:
    """Warp by any transform: the formula at the top of this file."""
    turn, (half, center) = _rotation(pose[2]), _extent(source)
    part_half, part_center = _extent(part)
    theta = np.empty((2, 3))
    theta[:, :2] = turn * part_half / half[:, None]
    theta[:, 2] = (turn @ part_center + pose[:2] - center) / half
    shape = [1, image.shape[1], *part.shape]
    grid = functional.affine_grid(
        torch.from_numpy(theta[None]).to(image.device, torch.float32), shape, align_corners=False
    )
    values = functional.grid_sample(image.float(), grid, padding_mode="zeros", align_corners=False)
    rows, columns = source.shape
    most = torch.tensor([(columns - 1 + 2 * _SLACK_CELLS) / columns, (rows - 1 + 2 * _SLACK_CELLS) / rows])
    inside = (grid[0].abs() <= most.to(grid)).all(-1)
    return torch.where(inside, values[0], 0.0).to(image.dtype), inside


def _overlap(source: BevGrid, target: BevGrid, pose: np.ndarray) -> tuple[slice, slice]:
    """Return the rows and columns of the target whose centres can lie between the source's outermost centres."""
    half, center = _extent(source)
    half = half - source.cell_m / 2
    corners = center + half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    corners = (corners - pose[:2]) @ _rotation(pose[2])
    found = []
    for axis, (low, _), cells in ((1, target.y_m, target.shape[0]), (0, target.x_m, target.shape[1])):
        place = (corners[:, axis] - low) / target.cell_m - 0.5
        first = math.ceil(place.min() - _SLACK_CELLS)
        last = math.floor(place.max() + _SLACK_CELLS)
        found.append(slice(min(max(0, first), cells), max(0, min(last + 1, cells))))
    return found[0], found[1]


def _part(grid: BevGrid, rows: slice, columns: slice) -> BevGrid:
    x = (grid.x_m[0] + columns.start * grid.cell_m, grid.x_m[0] + columns.stop * grid.cell_m)
    return BevGrid(x, (grid.y_m[0] + rows.start * grid.cell_m, grid.y_m[0] + rows.stop * grid.cell_m), grid.cell_m)


def _extent(grid: BevGrid) -> tuple[np.ndarray, np.ndarray]:
    """Return half the lengths along x and y, and the centre, m."""
    low, high = np.array([grid.x_m, grid.y_m]).T
    return (high - low) / 2, (high + low) / 2


def _rotation(yaw_rad: float) -> np.ndarray:
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[cos, -sin], [sin, cos]])


def _require(maps: Tensor, source: BevGrid, poses: np.ndarray, present: Tensor | None) -> None:
    if maps.ndim != 4 or tuple(maps.shape[-2:]) != source.shape or not maps.is_floating_point():
        raise InvalidValueError(
            f"maps must be floats of shape (S, C, {source.shape[0]}, {source.shape[1]}) as their grid has, "
            f"got {maps.dtype} {tuple(maps.shape)}"
        )
    if len(poses) != len(maps) or not np.isfinite(poses).all():
        raise InvalidValueError(f"source_SE2_target must be {len(maps)} finite poses x, y, yaw, got {poses.tolist()}")
    if present is not None and (present.shape != (len(maps), *source.shape) or present.dtype != torch.bool):
        raise InvalidValueError(
            f"present must be bool of shape {(len(maps), *source.shape)}, got {present.dtype} {tuple(present.shape)}"
        )
