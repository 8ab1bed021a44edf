"""Folders of nuScenes: the tables in `v1.0-mini` or another version, and sensors' files in `samples` beside them.

| record | read as |
|---|---|
| `sample` | a key frame; in between, where nothing is labelled, sweeps are not read |
| `sample_data` of LIDAR_TOP | rows of five float32: x (right), y (forward), z m, intensity to 255, ring |
| `ego_pose` | pose of the car's rear axle on the ground, z = 0, at the time of the sensor's file |
| `calibrated_sensor` | pose of the sensor in the car's frame; a camera's intrinsics |
| `sample_annotation` | boxes in the map: middle, width, length, height, quaternion; `instance_token` is the id |

The base frame is under the LiDAR, on the ground, along the car's heading. The world is the first base frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from coopsim.data.files.pcd import read_float_points
from coopsim.data.recordings.file_fields import Fields
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, class_of, sweep_in_base
from coopsim.data.single_car.nuscenes_tables import LIDAR, NuscenesTables, find_tables, time_us
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    RecordedAgent,
    RecordedFrame,
    RecordedObjects,
    RecordedPicture,
    RecordedSequence,
    SingleCarFolder,
    find_picture,
)
from coopsim.types import Sweep

HEIGHT_M = {"cav": 1.84}
"""Usual height of LIDAR_TOP over the ground; each scene's calibration says it exactly."""

_FULL_INTENSITY = 255.0
_NS_PER_US = 1000


@RECORDINGS.register("nuscenes")
@dataclass(frozen=True)
class NuscenesFolder(SingleCarFolder):
    """A folder of nuScenes, or the folder of its tables."""

    layout = "v1.0-<version>/scene.json with samples/ (nuScenes)"
    asked = 30
    usual_height_m = HEIGHT_M
    usual_frame_s = 0.5

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return bool(find_tables(path))

    @cached_property
    def tables(self) -> NuscenesTables:
        """The tables; raises `RecordingError` unless there are those of one version."""
        found = find_tables(self.path)
        if len(found) != 1:
            named = ", ".join(path.name for path in found) or "none"
            raise RecordingError(f"{self.path}: one folder of tables is needed, as v1.0-mini; give one of: {named}")
        return NuscenesTables(found[0])

    @property
    def sequences(self) -> tuple[str, ...]:
        return tuple(self.tables.scenes)

    def _open(self, sequence: str) -> NuscenesSequence:
        samples = tuple(self.tables.samples(self.tables.scenes[sequence]))
        if not samples:
            raise RecordingError(f"{self.tables.path / 'sample.json'} has no sample of scene {sequence}")
        height_m = self.options.height_m("cav", {"cav": np.nan})
        return NuscenesSequence(sequence, self.agents(sequence), self.frame_s, self.tables, samples, height_m)


@dataclass(frozen=True)
class NuscenesSequence(RecordedSequence):
    """A scene.

    Attributes:
        tables: tables of its folder.
        samples: records of its key frames, in order.
        height_m: height of the LiDAR over the ground; NaN: that of its calibration.
    """

    tables: NuscenesTables
    samples: Sequence[Fields]
    height_m: float

    @property
    def frames(self) -> int:
        return len(self.samples)

    def frame(self, number: int) -> RecordedFrame:
        datum = self._lidar(number)
        world_SE3_lidar = self._origin_SE3_map.compose(self._map_SE3_sensor(datum))
        world_SE3_base = self._origin_SE3_map.compose(self._map_SE3_base(datum))
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        agent = RecordedAgent(
            world_SE3_base,
            base_SE3_lidar,
            partial(_read_sweep, self.tables.file(datum), base_SE3_lidar),
            partial(self._pictures, number, world_SE3_base),
        )
        agents = dict.fromkeys(self.agents, agent)
        return RecordedFrame(self._time_ns(number) - self._time_ns(0), agents, self._objects(number))

    @cached_property
    def _origin_SE3_map(self) -> SE3:
        return self._map_SE3_base(self._lidar(0)).inverse()

    def _time_ns(self, number: int) -> int:
        return time_us(self.samples[number]) * _NS_PER_US

    def _lidar(self, number: int) -> Fields:
        sample = self.samples[number]
        datum = self.tables.datum(sample.text("token"), LIDAR)
        if datum is None:
            raise sample.error("token", f"must have a key frame of {LIDAR} in sample_data.json")
        return datum

    def _map_SE3_ego(self, datum: Fields) -> SE3:
        return self.tables.linked("ego_pose", datum).placed()

    def _map_SE3_sensor(self, datum: Fields) -> SE3:
        return self._map_SE3_ego(datum).compose(self.tables.linked("calibrated_sensor", datum).placed())

    def _map_SE3_base(self, lidar: Fields) -> SE3:
        """Return the upright frame under the LiDAR: its own axes are turned by a quarter, so the car's are taken."""
        height_m = self.height_m
        if np.isnan(height_m):
            height_m = float(self.tables.linked("calibrated_sensor", lidar).placed().translation[2])
        turned = SE3(self._map_SE3_ego(lidar).rotation, self._map_SE3_sensor(lidar).translation)
        return base_under(turned, height_m)

    @cached_property
    def _ids(self) -> dict[str, int]:
        """The ids of instances so far: the scene's first one has 1."""
        tokens: dict[str, int] = {}
        for sample in self.samples:
            for each in self.tables.annotations(sample.text("token")):
                tokens.setdefault(each.text("instance_token"), len(tokens) + 1)
        return tokens

    def _objects(self, number: int) -> RecordedObjects:
        rows = LabelledRows()
        for each in self.tables.annotations(self.samples[number].text("token")):
            instance = self.tables.linked("instance", each)
            label = class_of(self.tables.linked("category", instance), "name")
            if label is not None:
                pose, size = each.placed(), each.sizes("size", (3,))[[1, 0, 2]]
                rows.add(self._ids[each.text("instance_token")], pose.translation, size, pose.yaw, label)
        return rows.objects(self._origin_SE3_map)

    def _pictures(self, number: int, world_SE3_base: SE3) -> dict[str, RecordedPicture]:
        """Return the pictures that are there, each where its camera was when it was taken."""
        base_SE3_map = world_SE3_base.inverse().compose(self._origin_SE3_map)
        sample, found = self.samples[number].text("token"), dict[str, RecordedPicture]()
        for channel in self.tables.cameras(sample):
            datum = self.tables.datum(sample, channel)
            if datum is None or not self.tables.file(datum).is_file():
                continue
            matrix = self.tables.linked("calibrated_sensor", datum).numbers("camera_intrinsic", (3, 3))
            pose = base_SE3_map.compose(self._map_SE3_sensor(datum))
            found[channel.lower()] = find_picture(self.tables.file(datum), matrix, pose)
        return found


def _read_sweep(path: Path, base_SE3_lidar: SE3) -> Sweep:
    rows = read_float_points(path, 5)
    return sweep_in_base(base_SE3_lidar, rows[:, :3], rows[:, 3], _FULL_INTENSITY)
