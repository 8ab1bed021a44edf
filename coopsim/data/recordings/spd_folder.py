"""Folders of V2X-Seq-SPD: a car and a roadside unit at a junction, in pairs of frames.

| file | read as |
|---|---|
| `cooperative/data_info.json` | the pairs: `vehicle_frame`, `infrastructure_frame`, `vehicle_sequence` |
| `<side>/data_info.json` | of each frame the `pointcloud_timestamp` (microseconds) and the paths of its files |
| `cooperative/label/<vehicle frame>.json` | the objects, in the frame of the car's LiDAR at the time of its cloud |
| `<side>/velodyne/<frame>.pcd` | the clouds; an `intensity` up to 255 |
| `<side>/calib/...` | `novatel_to_world` after `lidar_to_novatel`, and `virtuallidar_to_world`: poses of the LiDARs |

A frame's time is that of the car's cloud; the roadside unit's is the one that is paired with it, some milliseconds off.
The world frame is the car's first base frame, as the files' coordinates are too large for float32. Ids become one
larger. Barrows count as bicycles, tricycles as motorcycles; traffic cones are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.files.pcd import read_pcd
from coopsim.data.recordings.file_fields import Fields, as_id, read_json
from coopsim.data.recordings.labelled_rows import LabelledRows, base_under, class_of, sweep_in_base
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    ReadingOptions,
    RecordedAgent,
    RecordedFolder,
    RecordedFrame,
    RecordedName,
    RecordedObjects,
    RecordedPicture,
    RecordedSequence,
    find_picture,
    name_agents,
)
from coopsim.types import Sweep

HEIGHT_M = {"cav": 1.7, "rsu": 1.7}
"""Heights of the LiDARs over the ground, which the files do not say; the roadside unit's is a virtual one."""

CAR, MAST = "vehicle-side", "infrastructure-side"
CAMERA = "camera"

_INFO = "data_info.json"
_NS_PER_US = 1000
_FULL_INTENSITY = 255.0
_TO_CAMERA = {CAR: "lidar_to_camera", MAST: "virtuallidar_to_camera"}


@dataclass(frozen=True, slots=True)
class SpdFrame:
    """A frame of one side.

    Attributes:
        number: its name, as "000012".
        time_ns: time of its cloud.
        files: paths of its files by the key in `data_info.json`, relative to the side's folder.
    """

    number: str
    time_ns: int
    files: Mapping[str, str]


@RECORDINGS.register("spd")
@dataclass(frozen=True)
class SpdFolder(RecordedFolder):
    """A folder of V2X-Seq-SPD."""

    layout = "cooperative/data_info.json with vehicle-side/ and infrastructure-side/ (V2X-Seq-SPD)"
    asked = 10
    usual_height_m = HEIGHT_M

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return (path / "cooperative" / "data_info.json").is_file()

    @cached_property
    def pairs(self) -> dict[str, list[tuple[SpdFrame, SpdFrame]]]:
        """The pairs of frames, car and roadside unit, by the car's sequence, in the order of time.

        Raises:
            RecordingError: one of the three lists is broken, or names a frame that another lacks.
        """
        sides = {side: _frames_of(self.path / side / _INFO) for side in (CAR, MAST)}
        path, found = self.path / "cooperative" / _INFO, dict[str, list[tuple[SpdFrame, SpdFrame]]]()
        for place, entry in enumerate(_entries(path)):
            fields = Fields(entry, path, f"[{place}]")
            pair: list[SpdFrame] = []
            for key, side in (("vehicle_frame", CAR), ("infrastructure_frame", MAST)):
                name = fields.text(key)
                if name not in sides[side]:
                    raise fields.error(key, f"must be a frame in {side}/{_INFO}, got {name!r}")
                pair.append(sides[side][name])
            found.setdefault(fields.text("vehicle_sequence"), []).append((pair[0], pair[1]))
        return {name: sorted(found[name], key=lambda pair: pair[0].time_ns) for name in sorted(found)}

    @property
    def sequences(self) -> tuple[str, ...]:
        return tuple(self.pairs)

    def agents(self, sequence: str) -> Mapping[str, RecordedName]:
        return name_agents((CAR,), (MAST,))

    def _open(self, sequence: str) -> SpdSequence:
        pairs = self.pairs[sequence]
        return SpdSequence(sequence, self.agents(sequence), self.frame_s, self.path, pairs, self.options)


@dataclass(frozen=True)
class SpdSequence(RecordedSequence):
    """A sequence of V2X-Seq-SPD."""

    path: Path
    pairs: Sequence[tuple[SpdFrame, SpdFrame]]
    options: ReadingOptions

    @property
    def frames(self) -> int:
        return len(self.pairs)

    def frame(self, number: int) -> RecordedFrame:
        car, mast = self.pairs[number]
        world_SE3_car = self._lidar(CAR, car)
        seen = {"cav_0": (CAR, car, world_SE3_car), "rsu_0": (MAST, mast, self._lidar(MAST, mast))}
        agents = {name: self._agent(self.agents[name], *of_side) for name, of_side in seen.items()}
        objects = _objects(self.path / "cooperative" / "label" / f"{car.number}.json", world_SE3_car)
        return RecordedFrame(car.time_ns - self.pairs[0][0].time_ns, agents, objects)

    @cached_property
    def _origin_SE3_world(self) -> SE3:
        first = self._in_file_world(CAR, self.pairs[0][0])
        return base_under(first, self.options.height_m("cav", HEIGHT_M)).inverse()

    def _lidar(self, side: str, frame: SpdFrame) -> SE3:
        """Return the pose of a side's LiDAR in the world frame, which is the car's first base frame."""
        return self._origin_SE3_world.compose(self._in_file_world(side, frame))

    def _in_file_world(self, side: str, frame: SpdFrame) -> SE3:
        if side == MAST:
            return self._calibration(side, frame, "virtuallidar_to_world")
        world_SE3_novatel = self._calibration(side, frame, "novatel_to_world")
        return world_SE3_novatel.compose(self._calibration(side, frame, "lidar_to_novatel"))

    def _calibration(self, side: str, frame: SpdFrame, name: str) -> SE3:
        path = self._file(side, frame, f"calib_{name}_path", f"calib/{name}/{frame.number}.json")
        fields = Fields(read_json(path), path)
        if "transform" in fields:
            fields = fields.section("transform")
        matrix = np.eye(4)
        matrix[:3, :3] = fields.numbers("rotation", (3, 3))
        matrix[:3, 3] = fields.numbers("translation", (3, 1), (3,)).reshape(3)
        return fields.as_transform("rotation", matrix)

    def _file(self, side: str, frame: SpdFrame, key: str, usual: str) -> Path:
        """Return the path of a frame's file, as its list says or as usual; it stays in the folder."""
        named = frame.files.get(key, usual)
        path = self.path / side / named
        if ".." in Path(named).parts or Path(named).is_absolute():
            raise RecordingError(f"{self.path / side / _INFO}: {key} must be a path in the folder, got {named!r}")
        return path

    def _agent(self, name: RecordedName, side: str, frame: SpdFrame, world_SE3_lidar: SE3) -> RecordedAgent:
        world_SE3_base = base_under(world_SE3_lidar, self.options.height_m(name.kind, HEIGHT_M))
        base_SE3_lidar = world_SE3_base.inverse().compose(world_SE3_lidar)
        cloud = self._file(side, frame, "pointcloud_path", f"velodyne/{frame.number}.pcd")
        return RecordedAgent(
            world_SE3_base,
            base_SE3_lidar,
            partial(_read_sweep, cloud, base_SE3_lidar),
            partial(self._pictures, side, frame, base_SE3_lidar),
        )

    def _pictures(self, side: str, frame: SpdFrame, base_SE3_lidar: SE3) -> dict[str, RecordedPicture]:
        picture = self._file(side, frame, "image_path", f"image/{frame.number}.jpg")
        if not picture.is_file():
            return {}
        path = self._file(side, frame, "calib_camera_intrinsic_path", f"calib/camera_intrinsic/{frame.number}.json")
        fields = Fields(read_json(path), path)
        matrix = fields.numbers("cam_K", (9,), (3, 3)).reshape(3, 3)
        lens = fields.numbers("cam_D", (5,)) if "cam_D" in fields else None
        camera_SE3_lidar = self._calibration(side, frame, _TO_CAMERA[side])
        return {CAMERA: find_picture(picture, matrix, base_SE3_lidar.compose(camera_SE3_lidar.inverse()), lens)}


def _entries(path: Path) -> list[Any]:
    content = read_json(path)
    if not isinstance(content, list):
        raise RecordingError(f"{path}: a list of frames is needed, got {type(content).__name__}")
    return content


def _frames_of(path: Path) -> dict[str, SpdFrame]:
    """Return one side's frames by their numbers."""
    found: dict[str, SpdFrame] = {}
    for place, entry in enumerate(_entries(path)):
        fields = Fields(entry, path, f"[{place}]")
        time_us = as_id(fields.value("pointcloud_timestamp"), path, f"[{place}].pointcloud_timestamp")
        number = fields.text("frame_id")
        files = {key: fields.text(key) for key in entry if str(key).endswith("_path")}
        found[number] = SpdFrame(number, time_us * _NS_PER_US, files)
    return found


def _objects(path: Path, world_SE3_lidar: SE3) -> RecordedObjects:
    rows, listed = LabelledRows(), set[int]()
    for place, entry in enumerate(_entries(path)):
        fields = Fields(entry, path, f"[{place}]")
        label = class_of(fields, "type")
        if label is None:
            continue
        track = as_id(fields.value("track_id"), path, f"[{place}].track_id")
        if track < 0 or track in listed:
            raise fields.error("track_id", f"must be >= 0 and different for each object, got {track}")
        listed.add(track)
        size, at = fields.section("3d_dimensions"), fields.section("3d_location")
        rows.add(
            track + 1,
            np.array([at.number(axis) for axis in "xyz"]),
            np.array([float(size.sizes(edge, ())) for edge in "lwh"]),
            fields.number("rotation"),
            label,
        )
    return rows.objects(world_SE3_lidar)


def _read_sweep(path: Path, base_SE3_lidar: SE3) -> Sweep:
    cloud = read_pcd(path)
    return sweep_in_base(base_SE3_lidar, cloud.points, cloud.intensity, _FULL_INTENSITY)
