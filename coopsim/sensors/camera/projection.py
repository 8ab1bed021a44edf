"""Points of an agent's base frame in the pictures of its cameras."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.distortion import distort, undistort
from coopsim.support.arrays import frozen
from coopsim.types import CameraCalibration

LEAST_DEPTH_M = 0.05
"""Depth along the optical axis from which a camera sees anything."""

_REMEMBERED = 256


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """N points in a picture.

    Attributes:
        place_px: (N, 2) column and row; of no meaning for points that are not inside.
        depth_m: (N,) along the optical axis.
        inside: (N,) bool, whether the picture has the point: in front of the camera and within the edges.
    """

    place_px: Floats
    depth_m: Floats
    inside: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class PictureBounds:
    """What a picture shows of the plane z = 1, where straight lines are straight.

    Attributes:
        low: (2,) smallest x and y of any of its rays.
        high: (2,) largest ones.
        farthest: longest distance of any of them from the optical axis: the lens may fold what is farther out back into
            the picture.
    """

    low: Floats
    high: Floats
    farthest: float


def project(calibration: CameraCalibration, points_m: Floats) -> Projected:
    """Project points into a camera's picture.

    Args:
        calibration: of the camera.
        points_m: (N, 3) in the agent's base frame.

    Raises:
        InvalidValueError: the points are of another shape, or the distortion folds the picture over.
    """
    seen = calibration.base_SE3_camera.inverse().apply(frozen(points_m, (None, 3), np.float64, "points_m"))
    depth_m = seen[:, 2]
    ahead = depth_m > LEAST_DEPTH_M
    flat = seen[:, :2] / np.where(ahead, depth_m, 1.0)[:, None]
    if calibration.distortion.any():
        ahead &= np.hypot(*flat.T) <= picture_bounds(calibration).farthest
    place_px = places_px(calibration, flat)
    rows, columns = calibration.size
    inside = ahead & (np.abs(place_px - [(columns - 1) / 2, (rows - 1) / 2]) <= [columns / 2, rows / 2]).all(1)
    return Projected(place_px, depth_m, inside)


def places_px(calibration: CameraCalibration, flat: Floats) -> Floats:
    """Return columns and rows (N, 2) of points (N, 2) of the plane z = 1 of the camera's frame."""
    lens, folds = calibration.matrix, calibration.distortion
    if folds.any():
        k1, k2, p1, p2, k3 = folds.tolist()
        flat = distort(flat, (k1, k2, p1, p2, k3))
    place_px: Floats = flat @ lens[:2, :2].T + lens[:2, 2]
    return place_px


def picture_bounds(calibration: CameraCalibration) -> PictureBounds:
    """Return the bounds of a camera's picture; they are found once for each lens.

    Raises:
        InvalidValueError: the distortion folds the picture over.
    """
    return _bounds(tuple(calibration.size), calibration.matrix.tobytes(), calibration.distortion.tobytes())


@lru_cache(_REMEMBERED)
def _bounds(size: tuple[int, int], matrix: bytes, distortion: bytes) -> PictureBounds:
    lens, folds = np.frombuffer(matrix).reshape(3, 3), np.frombuffer(distortion)
    rows, columns = size
    u, v = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
    edge = np.concatenate(
        [np.column_stack([u, np.full(len(u), end)]) for end in (v[0], v[-1])]
        + [np.column_stack([np.full(len(v), end), v]) for end in (u[0], u[-1])]
    )
    flat = (edge - lens[:2, 2]) @ np.linalg.inv(lens[:2, :2]).T
    k1, k2, p1, p2, k3 = folds.tolist()
    flat = undistort(flat, (k1, k2, p1, p2, k3))
    return PictureBounds(flat.min(axis=0), flat.max(axis=0), float(np.hypot(*flat.T).max()))
