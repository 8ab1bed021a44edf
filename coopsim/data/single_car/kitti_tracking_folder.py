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

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from coopsim.data.kitti import read_labels
from coopsim.data.recordings.labelled_rows import base_under
from coopsim.data.single_car.kitti_calibration import (
    CAMERA,
    CLOUDS,
    HEIGHT_M,
    KittiCalibration,
    KittiFrame,
    frame_number,
    has_clouds_and,
    lifted,
    read_kitti_calibration,
    root_of,
)
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    IN_PICTURE,
    RecordedFrame,
    RecordedObjects,
    RecordedSequence,
    SingleCarFolder,
)
from coopsim.types import Ints, seconds_to_ns

LABELS = "label_02"

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


@RECORDINGS.register("kitti")
@dataclass(frozen=True)
class KittiTrackingFolder(SingleCarFolder):
    """A folder of KITTI tracking: `training`, or the one above."""

    layout = "velodyne/<sequence>/<frame>.bin with label_02/ (KITTI tracking)"
    asked = 20
    usual_height_m = HEIGHT_M
    stands_alone = True

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return has_clouds_and(path, LABELS)

    @cached_property
    def root(self) -> Path:
        """The folder with `velodyne` and `label_02`."""
        return root_of(self.path)

    @cached_property
    def sequences(self) -> tuple[str, ...]:
        return tuple(sorted(entry.name for entry in (self.root / CLOUDS).iterdir() if entry.is_dir()))

    def _open(self, sequence: str) -> KittiTrackingSequence:
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
        clouds = self.root / CLOUDS / self.name
        numbers = [frame_number(path) for path in clouds.iterdir() if path.suffix == ".bin"]
        if not numbers:
            raise RecordingError(f"{clouds} has no <frame>.bin")
        return 1 + max(numbers)

    def frame(self, number: int) -> RecordedFrame:
        world_SE3_lidar = self._poses[number] if self._poses is not None else lifted(self.height_m)
        stem = f"{number:06d}"
        cloud, picture = (self.root / part / self.name / stem for part in (CLOUDS, CAMERA))
        files = KittiFrame(self._calibration, cloud.with_suffix(".bin"), picture, self.in_picture)
        agent = files.agent(world_SE3_lidar, self.height_m)
        frame, every = self._labels
        labelled = every[np.flatnonzero(frame == number)]
        objects = files.objects(labelled, world_SE3_lidar)
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
        path = self.root / LABELS / f"{self.name}.txt"
        if not path.is_file():
            raise RecordingError(f"no file {path}: it has the labels")
        frame, ids, boxes, label, _ = read_labels(path)
        if len(ids) and ids.min() < 0:
            raise RecordingError(f"{path}: ids of objects must be >= 0, got {ids.min()}")
        return frame, RecordedObjects(ids + 1, boxes, label)
