"""Depths that points measure in the cells of a picture's features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.nn.camera.sight import STRIDE_PX, cells_of
from coopsim.sensors.camera.projection import project
from coopsim.types import CameraCalibration


def measured_depth(calibration: CameraCalibration, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the depth of the nearest point in each cell of a picture's features, (h, w) m; 0 where there is no point.

    Args:
        calibration: of the camera.
        points_m: (P, 3) in the base frame of the camera's agent, of its own LiDARs or also of other agents'.

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
