"""Folders of KITTI's tracking benchmark: one car, whose labels are what its left colour camera shows.

| file | read as |
|---|---|
| `velodyne/<sequence>/<frame>.bin` | rows of four float32: x, y, z m in the LiDAR's frame, reflectance in [0, 1] |
| `label_02/<sequence>.txt` | as `coopsim.data.kitti`, in the rectified camera's frame; ids become one larger |
| `calib/<sequence>.txt` | `P2`, `R_rect`, `Tr_velo_cam`, `Tr_imu_velo`, or by the names that other benchmarks use |
| `oxts/<sequence>.txt` | a line a frame: latitude, longitude (degrees), altitude m, roll, pitch, yaw rad, ... |
| `image_02/<sequence>/<frame>.png` | the pictures |

Only what is in the picture is labelled, so only points in the picture are kept, as detectors for KITTI do, unless the
option `points` is "all". A frame whose cloud is missing has no points: the benchmark lacks a few.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq

from coopsim.data.files.pcd import read_float_points
from coopsim.data.kitti import AXES_SE3_CAMERA, read_labels
from coopsim.data.recordings.file_fields import Fields
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, sweep_in_base
from coopsim.data.recordings.recorded_folder import (
    IN_PICTURE,
    RecordedAgent,
    RecordedFolder,
    RecordedFrame,
    RecordedName,
    RecordedObjects,
    RecordedPicture,
    RecordedSequence,
    find_picture,
    name_agents,
    picture_size,
)
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_choice
from coopsim.types import Ints, Sweep, seconds_to_ns

EARTH_M = 6378137.0
"""Radius of the sphere on which latitudes and longitudes are projected."""

_FIELDS = 6  # of those that are used: latitude, longitude, altitude, roll, pitch, yaw


def read_gps_poses(path: Path) -> list[SE3]:
    """Read `world_SE3_imu` of every frame; the world's x points east, y north, its origin is the first position.

    A line is a frame: latitude and longitude (degrees), altitude m, roll, pitch, yaw rad (x forward, y left, z up; 0 is
    east), and more. Positions are those of the Mercator projection, scaled by the cosine of the first latitude, as
    KITTI's own development kit has them:

        x = s R longitude,   y = s R log tan(pi/4 + latitude/2),   s = cos(first latitude).

    Raises:
        RecordingError: the file is missing, empty, or has a broken line, which is named.
    """
    rows = _read(path)
    latitude, longitude = np.radians(rows[:, 0]), np.radians(rows[:, 1])
    scale = EARTH_M * np.cos(latitude[0])
    place = np.column_stack([scale * longitude, scale * np.log(np.tan(np.pi / 4 + latitude / 2)), rows[:, 2]])
    return [SE3(_turn(*angles), at) for angles, at in zip(rows[:, 3:], place - place[0], strict=True)]


def _read(path: Path) -> Floats:
    try:
        lines = path.read_text(encoding="utf-8").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        try:
            row = [float(word) for word in line.split()[:_FIELDS]]
        except ValueError as error:
            raise RecordingError(f"{path}, line {number}: {error}") from None
        if len(row) < _FIELDS or not np.isfinite(row).all() or abs(row[0]) >= 90:
            raise RecordingError(
                f"{path}, line {number}: latitude, longitude, altitude, roll, pitch and yaw are needed, finite and "
                f"with a latitude between -90 and 90, got {' '.join(line.split()[:_FIELDS])!r}"
            )
        rows.append(row)
    if not rows:
        raise RecordingError(f"{path} is empty: it needs a line for each frame")
    return np.array(rows)


def _turn(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


HEIGHT_M = {"cav": 1.73}
"""Height of KITTI's LiDAR over the ground."""

CAMERA = "image_02"
CAR = "car"

_USUAL_SIZE = 375, 1242  # of a picture, where there is none


@dataclass(frozen=True)
class KittiTrackingFolder(RecordedFolder):
    """A folder of KITTI tracking: `training`, or the one above."""

    usual_height_m = HEIGHT_M
    stands_alone = True

    @cached_property
    def root(self) -> Path:
        """The folder with `velodyne` and `label_02`."""
        inner = self.path / "training"
        return inner if inner.is_dir() and not (self.path / "velodyne").is_dir() else self.path

    @cached_property
    def sequences(self) -> tuple[str, ...]:
        return tuple(sorted(entry.name for entry in (self.root / "velodyne").iterdir() if entry.is_dir()))

    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        return name_agents((CAR,))

    def open(self, sequence: str) -> KittiTrackingSequence:
        require_choice("sequence", sequence, self.sequences, f"in {self.path}")
        height_m = self.options.height_m("cav", HEIGHT_M)
        return KittiTrackingSequence(
            sequence,
            self.agents(sequence),
            self.frame_s,
            self.root,
            height_m,
            with_poses=self.options.odometry != "none",
            in_picture=self.options.points == IN_PICTURE,
        )


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


@dataclass(frozen=True)
class KittiTrackingSequence(RecordedSequence):
    """A sequence of KITTI tracking.

    Attributes:
        root: the folder with `velodyne` and `label_02`.
        height_m: height of the LiDAR over the ground.
        with_poses: read the car's poses; otherwise it stands.
        in_picture: keep only the points in the picture.
    """

    root: Path
    height_m: float
    with_poses: bool
    in_picture: bool

    @cached_property
    def frames(self) -> int:
        numbers = [_number(path) for path in (self.root / "velodyne" / self.name).iterdir() if path.suffix == ".bin"]
        if not numbers:
            raise RecordingError(f"{self.root / 'velodyne' / self.name} has no <frame>.bin")
        return 1 + max(numbers)

    def frame(self, number: int) -> RecordedFrame:
        world_SE3_lidar = self._poses[number] if self._poses is not None else _lifted(self.height_m)
        world_SE3_base = base_under(world_SE3_lidar, self.height_m)
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        agent = RecordedAgent(
            world_SE3_base,
            base_SE3_lidar,
            partial(self._sweep, number, base_SE3_lidar),
            partial(self._pictures, number, base_SE3_lidar),
        )
        objects = self._objects(number, world_SE3_lidar)
        return RecordedFrame(seconds_to_ns(number * self.frame_s), dict.fromkeys(self.agents, agent), objects)

    @cached_property
    def _calibration(self) -> KittiCalibration:
        return read_kitti_calibration(self.root / "calib" / f"{self.name}.txt")

    @cached_property
    def _poses(self) -> list[SE3] | None:
        """The LiDAR's poses in an upright world, which begins on the ground under the first one; None: it stands."""
        if not self.with_poses:
            return None
        path = self.root / "oxts" / f"{self.name}.txt"
        if not path.is_file():
            raise RecordingError(f"no file {path}: it has the car's poses; odometry='none' does without")
        if self._calibration.lidar_SE3_imu is None:
            raise RecordingError(f"{self.root / 'calib' / self.name}.txt: Tr_imu_velo is missing")
        imu_SE3_lidar = self._calibration.lidar_SE3_imu.inverse()
        poses = [pose.compose(imu_SE3_lidar) for pose in read_gps_poses(path)]
        if len(poses) < self.frames:
            raise RecordingError(f"{path}: a line for each of {self.frames} frames is needed, got {len(poses)}")
        base_SE3_world = base_under(poses[0], self.height_m).inverse()
        return [base_SE3_world.compose(pose) for pose in poses]

    @cached_property
    def _labels(self) -> tuple[Ints, RecordedObjects]:
        """The frames (N,) of all labels, and the labels in our axes of the rectified camera's frame."""
        path = self.root / "label_02" / f"{self.name}.txt"
        if not path.is_file():
            raise RecordingError(f"no file {path}: it has the labels")
        frame, ids, boxes, label, _ = read_labels(path)
        if len(ids) and ids.min() < 0:
            raise RecordingError(f"{path}: ids of objects must be >= 0, got {ids.min()}")
        return frame, RecordedObjects(ids + 1, boxes, label)

    def _objects(self, number: int, world_SE3_lidar: SE3) -> RecordedObjects:
        frame, every = self._labels
        rows = LabelledRows()
        for row in np.flatnonzero(frame == number).tolist():
            center, size, yaw = every.boxes.center[row], every.boxes.size[row], float(every.boxes.yaw[row])
            rows.add(int(every.id[row]), center, size, yaw, int(every.label[row]))
        lidar_SE3_axes = self._calibration.rectified_SE3_lidar.inverse().compose(AXES_SE3_CAMERA.inverse())
        return rows.objects(world_SE3_lidar.compose(lidar_SE3_axes))

    def _sweep(self, number: int, base_SE3_lidar: SE3) -> Sweep:
        path = self.root / "velodyne" / self.name / f"{number:06d}.bin"
        if not path.is_file():
            return Sweep.empty()
        points = read_float_points(path, 4)
        picture = self._picture_path(number)
        if self.in_picture:
            size = picture_size(picture) if picture is not None else _USUAL_SIZE
            points = points[self._calibration.shows(points[:, :3], size)]
        return sweep_in_base(base_SE3_lidar, points[:, :3], points[:, 3])

    def _pictures(self, number: int, base_SE3_lidar: SE3) -> dict[str, RecordedPicture]:
        path = self._picture_path(number)
        if path is None:
            return {}
        matrix, lidar_SE3_camera = self._calibration.camera
        return {CAMERA: find_picture(path, matrix, base_SE3_lidar.compose(lidar_SE3_camera))}

    def _picture_path(self, number: int) -> Path | None:
        for ending in (".png", ".jpg"):
            path = self.root / CAMERA / self.name / f"{number:06d}{ending}"
            if path.is_file():
                return path
        return None


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


def _lifted(height_m: float) -> SE3:
    return SE3(np.eye(3), np.array([0.0, 0.0, height_m]))


def _number(path: Path) -> int:
    if not re.fullmatch(r"\d{1,9}", path.stem):
        raise RecordingError(f"{path}: the name of a cloud must be the frame's number, got {path.stem!r}")
    return int(path.stem)
