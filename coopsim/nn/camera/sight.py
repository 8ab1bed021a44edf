"""Where the cells of a picture's features look: lines in space, for any lens and mounting."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.distortion import undistort
from coopsim.types import CameraCalibration

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
        ray: (3, h, w) float32, through the middle of each cell: what the cell shows at a depth of d m along the optical
            axis is at start_m + d * ray.
        geometry: (4, h, w) float32: inverse depth of the nearest ground in the cell, in 1/dam (0: above the horizon);
            elevation of the ray in rad; logarithm of cells per radian, less 3; logarithm of the camera's height in m.
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
