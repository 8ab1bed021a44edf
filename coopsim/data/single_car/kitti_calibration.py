"""KITTI's car: calibration of LiDAR, left colour camera and inertial unit, and the files of a frame that it joins."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq

from coopsim.data.files.pcd import read_float_points
from coopsim.data.kitti import AXES_SE3_CAMERA
from coopsim.data.recordings.file_fields import Fields
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, sweep_in_base
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.recordings.recorded_folder import (
    RecordedAgent,
    RecordedObjects,
    RecordedPicture,
    find_picture,
    picture_size,
)
from coopsim.types import Sweep

HEIGHT_M = {"cav": 1.73}
"""Height of KITTI's LiDAR over the ground."""

CLOUDS = "velodyne"
"""Name of the folder of clouds."""

CAMERA = "image_02"
"""Name of the left colour camera."""

_USUAL_SIZE = 375, 1242  # of a picture, where there is none


def has_clouds_and(path: Path, labels: str) -> bool:
    """Return whether a folder, or `training` in it, has clouds and this folder of labels."""
    return any((place / CLOUDS).is_dir() and (place / labels).is_dir() for place in (path, path / "training"))


def root_of(path: Path) -> Path:
    """Return the folder with the clouds: a given one, or `training` in it."""
    inner = path / "training"
    return inner if inner.is_dir() and not (path / CLOUDS).is_dir() else path


@dataclass(frozen=True)
class KittiCalibration:
    """Calibration of a sequence.

    Attributes:
        projection: (3, 4) from the rectified camera's frame to pixels of the left colour camera.
        rectified_SE3_lidar: from the LiDAR's frame to that of the rectified camera.
        lidar_SE3_imu: from the frame of the inertial unit to the LiDAR's; None: it is not in the file.
    """

    projection: Floats
    rectified_SE3_lidar: SE3
    lidar_SE3_imu: SE3 | None

    @cached_property
    def camera(self) -> tuple[Floats, SE3]:
        """The camera's K (3, 3), and its pose in the LiDAR's frame: the projection is K R [1 | -place]."""
        scaled, turn = (np.asarray(part, np.float64) for part in rq(self.projection[:, :3]))
        signs = np.sign(np.diag(scaled))
        scaled, turn = scaled * signs, signs[:, None] * turn
        matrix = scaled / scaled[2, 2]
        matrix[0, 1] = 0.0  # what rounding leaves
        place = np.asarray(-np.linalg.solve(self.projection[:, :3], self.projection[:, 3]), np.float64)
        return matrix, self.rectified_SE3_lidar.inverse().compose(SE3(turn.T, place))

    def shows(self, points: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.bool_]:
        """Return the mask (P,) of points (P, 3) in the LiDAR's frame that are in a picture of this height and width."""
        there = self.rectified_SE3_lidar.apply(points)
        u, v, depth = (there @ self.projection[:, :3].T + self.projection[:, 3]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = u / depth, v / depth
        inside: NDArray[np.bool_] = (depth > 0) & (column >= 0) & (row >= 0) & (column < size[1]) & (row < size[0])
        return inside


def read_kitti_calibration(path: Path) -> KittiCalibration:
    """Read a calibration; a key may have a colon behind it.

    Raises:
        RecordingError: the file is missing, or a line is missing or broken; names it.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    words = (line.split() for line in lines if line.strip())
    fields = Fields({key.rstrip(":"): numbers for key, *numbers in words}, path)
    rectified, from_lidar, from_imu = (
        next((name for name in names if name in fields), names[0])
        for names in (
            ("R_rect", "R0_rect"),
            ("Tr_velo_cam", "Tr_velo_to_cam"),
            ("Tr_imu_velo", "Tr_imu_to_velo"),
        )
    )
    turn = fields.numbers(rectified, (9,)).reshape(3, 3)
    rectified_SE3_camera = fields.as_transform(rectified, _square(np.column_stack([turn, np.zeros(3)])))
    return KittiCalibration(
        fields.numbers("P2", (12,)).reshape(3, 4),
        rectified_SE3_camera.compose(_transform(fields, from_lidar)),
        _transform(fields, from_imu) if from_imu in fields else None,
    )


def _transform(fields: Fields, key: str) -> SE3:
    return fields.as_transform(key, _square(fields.numbers(key, (12,)).reshape(3, 4)))


def _square(matrix: Floats) -> Floats:
    return np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class KittiFrame:
    """Files of a frame.

    Attributes:
        calibration: calibration of the car.
        cloud: rows of four float32: x, y, z m in the LiDAR's frame, reflectance in [0, 1].
        picture: PNG or JPEG file of the left colour camera, without its ending.
        in_picture: keep only the points in the picture.
    """

    calibration: KittiCalibration
    cloud: Path
    picture: Path
    in_picture: bool

    def agent(self, world_SE3_lidar: SE3, height_m: float) -> RecordedAgent:
        """Return the car, whose LiDAR is so high above the ground."""
        world_SE3_base = base_under(world_SE3_lidar, height_m)
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        read, find = partial(self._sweep, base_SE3_lidar), partial(self._pictures, base_SE3_lidar)
        return RecordedAgent(world_SE3_base, base_SE3_lidar, read, find)

    def objects(self, labelled: RecordedObjects, world_SE3_lidar: SE3) -> RecordedObjects:
        """Return objects of label files, in our axes of the rectified camera's frame, in the world frame."""
        rows, boxes = LabelledRows(), labelled.boxes
        for row in range(len(labelled)):
            size, yaw_rad = boxes.size[row], float(boxes.yaw[row])
            rows.add(int(labelled.id[row]), boxes.center[row], size, yaw_rad, int(labelled.label[row]))
        lidar_SE3_axes = self.calibration.rectified_SE3_lidar.inverse().compose(AXES_SE3_CAMERA.inverse())
        return rows.objects(world_SE3_lidar.compose(lidar_SE3_axes))

    def _sweep(self, base_SE3_lidar: SE3) -> Sweep:
        if not self.cloud.is_file():
            return Sweep.empty()
        points = read_float_points(self.cloud, 4)
        if self.in_picture:
            path = self._picture_file
            size = picture_size(path) if path is not None else _USUAL_SIZE
            points = points[self.calibration.shows(points[:, :3], size)]
        return sweep_in_base(base_SE3_lidar, points[:, :3], points[:, 3])

    def _pictures(self, base_SE3_lidar: SE3) -> dict[str, RecordedPicture]:
        path = self._picture_file
        if path is None:
            return {}
        matrix, lidar_SE3_camera = self.calibration.camera
        return {CAMERA: find_picture(path, matrix, base_SE3_lidar.compose(lidar_SE3_camera))}

    @property
    def _picture_file(self) -> Path | None:
        files = (self.picture.with_suffix(ending) for ending in (".png", ".jpg"))
        return next((path for path in files if path.is_file()), None)


def lifted(height_m: float) -> SE3:
    """Return the pose of a LiDAR that is so high above the world's origin."""
    return SE3(np.eye(3), np.array([0.0, 0.0, height_m]))


def frame_number(path: Path) -> int:
    """Return the number of the frame of a cloud's file.

    Raises:
        RecordingError: the file's name is no number.
    """
    if not re.fullmatch(r"\d{1,9}", path.stem):
        raise RecordingError(f"{path}: the name of a cloud must be the frame's number, got {path.stem!r}")
    return int(path.stem)
