"""Folders of Argoverse 2's sensor data set: a log, a split, or the folder of splits (Wilson et al., NeurIPS 2021).

| file of a log | read as |
|---|---|
| `sensors/lidar/<ns>.feather` | `x`, `y`, `z` m of both LiDARs, moved into the car's frame; `intensity` to 255 |
| `annotations.feather` | `timestamp_ns`, `track_uuid`, `category`, sizes and pose of each box in the car's frame then |
| `city_SE3_egovehicle.feather` | `timestamp_ns` and pose of the car in the city |
| `calibration/egovehicle_SE3_sensor.feather` | `sensor_name` and pose of each sensor in the car's frame |

The car's frame lies on its rear axle; the base frame is under its upper LiDAR, on the ground. The world is the first
base frame. Pictures are not read: no camera of the car is triggered at the time of a sweep.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.files.feather import read_feather
from coopsim.data.recordings.file_fields import pose_of_quaternion
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, class_named, sweep_in_base
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import SE3, Floats
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    CAR,
    RecordedAgent,
    RecordedFrame,
    RecordedObjects,
    RecordedSequence,
    SingleCarFolder,
)
from coopsim.types import Ints, Sweep

AXLE_M = 0.33
"""Height of the rear axle over the ground, by a maintainer in argoverse/argoverse-api, issue 286."""

HEIGHT_M = {"cav": 1.97}
"""Usual height of the upper LiDAR over the ground; a log's calibration says it exactly."""

LIDAR = "up_lidar"

_FULL_INTENSITY = 255.0
_POSE = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
_SIZE = ("length_m", "width_m", "height_m")
_DEEPEST = 3  # folders between the one that is given and a log, as in root/sensor/val/log

_RIDDEN = {"BICYCLE": "BICYCLIST", "MOTORCYCLE": "MOTORCYCLIST"}
"""Vehicles, and their riders who have boxes of their own: with us the two are one object."""


def find_logs(path: Path, deeper: int = _DEEPEST) -> Iterator[Path]:
    """Yield the folders of logs in a folder and below it."""
    if (path / "sensors" / "lidar").is_dir():
        yield path
    elif deeper:
        for entry in sorted(path.iterdir()):
            if entry.is_dir():
                yield from find_logs(entry, deeper - 1)


@RECORDINGS.register("argoverse2")
@dataclass(frozen=True)
class Argoverse2Folder(SingleCarFolder):
    """A folder of Argoverse 2."""

    layout = "<log>/sensors/lidar/<ns>.feather with annotations.feather (Argoverse 2)"
    asked = 70
    usual_height_m = HEIGHT_M

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return next(find_logs(path), None) is not None

    @cached_property
    def logs(self) -> Mapping[str, Path]:
        """The logs by name, sorted."""
        return dict(sorted((log.name or CAR, log) for log in find_logs(self.path)))

    @property
    def sequences(self) -> tuple[str, ...]:
        return tuple(self.logs)

    def _open(self, sequence: str) -> Argoverse2Sequence:
        log = self.logs[sequence]
        stamps = [int(path.stem) for path in (log / "sensors" / "lidar").glob("*.feather") if path.stem.isdecimal()]
        if not stamps:
            raise RecordingError(f"{log / 'sensors' / 'lidar'} has no <time stamp>.feather")
        ego_SE3_lidar = _mounting(log / "calibration" / "egovehicle_SE3_sensor.feather")
        height_m = self.options.height_m("cav", {"cav": AXLE_M + float(ego_SE3_lidar.translation[2])})
        agents, sorted_stamps = self.agents(sequence), tuple(sorted(stamps))
        return Argoverse2Sequence(sequence, agents, self.frame_s, log, sorted_stamps, ego_SE3_lidar, height_m)


@dataclass(frozen=True)
class Argoverse2Sequence(RecordedSequence):
    """A log.

    Attributes:
        log: its folder.
        stamps: time stamps of its sweeps, ns, in order.
        ego_SE3_lidar: pose of the upper LiDAR in the car's frame.
        height_m: height of that LiDAR over the ground.
    """

    log: Path
    stamps: tuple[int, ...]
    ego_SE3_lidar: SE3
    height_m: float

    @property
    def frames(self) -> int:
        return len(self.stamps)

    def frame(self, number: int) -> RecordedFrame:
        stamp = self.stamps[number]
        world_SE3_ego = self._origin_SE3_city.compose(self._city_SE3_ego(stamp))
        world_SE3_base = self._base(world_SE3_ego)
        base_SE3_ego = world_SE3_base.inverse().compose(world_SE3_ego)
        cloud = self.log / "sensors" / "lidar" / f"{stamp}.feather"
        base_SE3_lidar = base_SE3_ego.compose(self.ego_SE3_lidar)
        agent = RecordedAgent(world_SE3_base, base_SE3_lidar, partial(_read_sweep, cloud, base_SE3_ego))
        objects = self._objects(stamp, world_SE3_ego)
        return RecordedFrame(stamp - self.stamps[0], dict.fromkeys(self.agents, agent), objects)

    def _base(self, parent_SE3_ego: SE3) -> SE3:
        """Return the upright frame under the LiDAR along the car's heading, of the car's pose."""
        lidar_at = parent_SE3_ego.compose(self.ego_SE3_lidar).translation
        return base_under(SE3(parent_SE3_ego.rotation, lidar_at), self.height_m)

    @cached_property
    def _origin_SE3_city(self) -> SE3:
        return self._base(self._city_SE3_ego(self.stamps[0])).inverse()

    @cached_property
    def _poses(self) -> tuple[Path, Ints, Floats]:
        """The file of the car's poses, their time stamps (K,) and their rows (K, 7)."""
        path = self.log / "city_SE3_egovehicle.feather"
        columns = read_feather(path, ("timestamp_ns", *_POSE))
        return path, columns["timestamp_ns"].astype(np.int64), _rows(columns, _POSE)

    def _city_SE3_ego(self, stamp: int) -> SE3:
        path, stamps, rows = self._poses
        row = np.flatnonzero(stamps == stamp)
        if not len(row):
            raise RecordingError(f"{path}: no pose has the time stamp {stamp} of a sweep")
        return _pose(rows[row[0]], path)

    @cached_property
    def _labels(self) -> tuple[Path, Mapping[str, NDArray[Any]], Floats, Ints]:
        """The file of the labels, their columns, their rows (N, 10) of sizes and poses, and their ids (N,)."""
        path = self.log / "annotations.feather"
        columns = read_feather(path, ("timestamp_ns", *_SIZE, *_POSE), ("track_uuid", "category"))
        rows = _rows(columns, (*_SIZE, *_POSE))
        if rows[:, :3].min(initial=1.0) <= 0:
            raise RecordingError(f"{path}: columns {', '.join(_SIZE)} must be > 0")
        ids = np.unique(columns["track_uuid"].astype(str), return_inverse=True)[1].astype(np.int64) + 1
        return path, columns, rows, ids

    def _objects(self, stamp: int, world_SE3_ego: SE3) -> RecordedObjects:
        path, columns, every, ids = self._labels
        rows, categories = LabelledRows(), list[str]()
        for row in np.flatnonzero(columns["timestamp_ns"] == stamp).tolist():
            category = str(columns["category"][row])
            label = class_named(category, f"{path}: column category")
            if label is not None:
                pose = _pose(every[row, 3:], path)
                rows.add(int(ids[row]), pose.translation, every[row, :3], pose.yaw, label)
                categories.append(category)
        return _without_ridden(rows.objects(world_SE3_ego), np.array(categories, dtype=str))


def _without_ridden(objects: RecordedObjects, category: NDArray[np.str_]) -> RecordedObjects:
    """Leave out the vehicles (N,) on which a rider sits, whose box covers their centre."""
    kept = np.ones(len(objects), np.bool_)
    for vehicle, rider in _RIDDEN.items():
        riders = objects.boxes[np.flatnonzero(category == rider)]
        for row in np.flatnonzero(category == vehicle):
            kept[row] = not covers(riders, objects.boxes.center[row, :2]).any()
    return objects[np.flatnonzero(kept)]


def _mounting(path: Path) -> SE3:
    columns = read_feather(path, _POSE, ("sensor_name",))
    row = np.flatnonzero(columns["sensor_name"] == LIDAR)
    if not len(row):
        raise RecordingError(f"{path}: column sensor_name has no {LIDAR}")
    return _pose(_rows(columns, _POSE)[row[0]], path)


def _rows(columns: Mapping[str, NDArray[Any]], names: tuple[str, ...]) -> Floats:
    return np.column_stack([columns[name].astype(np.float64) for name in names])


def _pose(row: Floats, path: Path) -> SE3:
    """Return the pose of a row (7,): a quaternion w, x, y, z and a place."""
    try:
        return pose_of_quaternion(row[:4], row[4:])
    except InvalidValueError as error:
        raise RecordingError(f"{path}: columns qw, qx, qy, qz {error}") from error


def _read_sweep(path: Path, base_SE3_ego: SE3) -> Sweep:
    columns = read_feather(path, ("x", "y", "z", "intensity"))
    points = np.column_stack([columns[axis].astype(np.float32) for axis in "xyz"]).reshape(-1, 3)
    return sweep_in_base(base_SE3_ego, points, columns["intensity"].astype(np.float32), _FULL_INTENSITY)
