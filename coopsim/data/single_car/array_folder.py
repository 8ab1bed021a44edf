"""Folders of plain arrays: sweeps and boxes of one car in the simplest files that people make.

| file | read as |
|---|---|
| `<sequence>_<number>.npz` | a frame with the arrays below, z = 0 on the ground |
| `points`, (N, 3 or more) | x forward, y left, z up in m; the fourth column is an intensity, to 1 or to 255 |
| `boxes`, (M, 7) | x, y, z of the middle, length, width, height m, heading rad |
| `names`, (M,) | their types in any data set's words |
| `ids`, (M,) integers | optional: identities over the sequence |
| `doubtful`, (K, 7) | optional: boxes where an object may be that is not labelled; training takes them for nothing |
| `fov_deg` | optional: boxes are labelled up to half of this to the left and right |
| `pose`, (4, 4) | optional: the car's pose in the world, upright, on the ground; otherwise it stands |
| `time_s` | optional: else frames are `frame_s` apart |
| `points/<frame>.npy` or `.bin` | (N, 3 or more), or rows of four float32, in the LiDAR's frame |
| `labels/<frame>.txt` | lines x y z length width height heading type, as OpenPCDet and MMDetection3D have them |

Points and boxes of the second kind are in the frame of the LiDAR, which is `lidar_height_m` above the ground.
Without identities, frames are unrelated, and so far apart that nothing joins their sweeps.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.files.pcd import read_float_points
from coopsim.data.recordings.file_fields import Fields
from coopsim.data.recordings.labelled_rows import LabelledRows, class_named, ids_of_frame, sweep_in_base
from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    IN_PICTURE,
    UNRELATED_S,
    ReadingOptions,
    RecordedAgent,
    RecordedFrame,
    RecordedObjects,
    RecordedSequence,
    SingleCarFolder,
)
from coopsim.support.plain_arrays import read_npy, read_npz
from coopsim.types import Ints, Sweep, seconds_to_ns

HEIGHT_M = {"cav": 1.8}
"""Usual height of a LiDAR on a car's roof."""

POINTS, LABELS = "points", "labels"
"""Folders of clouds and of text files with boxes."""

_CLOUDS = (".npy", ".bin")
_BROKEN = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
MOST_BYTES = 2**28
"""Most bytes of a file, and of its arrays: eight million points of four doubles."""

_NO_BOXES = np.zeros((0, 7)), np.zeros(0, np.str_)
_LABELS = ("boxes", "names")
_OPTIONAL = ("ids", "fov_deg", "pose", "time_s", "doubtful")


@RECORDINGS.register("arrays")
@dataclass(frozen=True)
class ArrayFolder(SingleCarFolder):
    """A folder of plain arrays."""

    layout = "<sequence>_<number>.npz, or points/<frame>.npy with labels/ (arrays)"
    asked = 40
    usual_height_m = HEIGHT_M
    usual_frame_s = UNRELATED_S
    stands_alone = True

    @classmethod
    def found_in(cls, path: Path) -> bool:
        if (path / POINTS).is_dir():
            return True
        of_text = any((path / name).is_dir() for name in ("labels", "detections"))
        return not of_text and next(path.glob("*.npz"), None) is not None

    @cached_property
    def files(self) -> Mapping[str, tuple[Path, ...]]:
        """The frames' files by sequence, in order of their numbers."""
        found: dict[str, list[tuple[int, Path]]] = {}
        for path in self.path.glob("*.npz"):
            name, number = _sequence_of(path)
            found.setdefault(name, []).append((number, path))
        if not found:
            clouds = [path for path in (self.path / POINTS).iterdir() if path.suffix in _CLOUDS]
            found = {POINTS: list(enumerate(sorted(clouds)))} if clouds else {}
        return {name: tuple(path for _, path in sorted(files)) for name, files in sorted(found.items())}

    @property
    def sequences(self) -> tuple[str, ...]:
        return tuple(self.files)

    def _open(self, sequence: str) -> ArraySequence:
        files = self.files[sequence]
        return ArraySequence(sequence, self.agents(sequence), self.frame_s, files, self.options)


@dataclass(frozen=True)
class ArraySequence(RecordedSequence):
    """Frames of a sequence.

    Attributes:
        files: clouds, or whole frames.
        options: choices that the files leave open.
    """

    files: tuple[Path, ...]
    options: ReadingOptions

    @property
    def frames(self) -> int:
        return len(self.files)

    def frame(self, number: int) -> RecordedFrame:
        path = self.files[number]
        base_SE3_lidar = SE3.from_xyz_yaw([0.0, 0.0, self.options.height_m("cav", HEIGHT_M)], 0.0)
        if path.suffix == ".npz":
            return self._whole_frame(number, base_SE3_lidar)
        labels = path.parent.with_name(LABELS) / f"{path.stem}.txt"
        boxes, names = _read_boxes(labels) if self.options.labelled else _NO_BOXES
        objects = _objects(boxes, names, ids_of_frame(number, len(names)), base_SE3_lidar, labels)
        agent = RecordedAgent(SE3.identity(), base_SE3_lidar, partial(_read_cloud, path, base_SE3_lidar))
        return RecordedFrame(seconds_to_ns(number * self.frame_s), dict.fromkeys(self.agents, agent), objects)

    def _whole_frame(self, number: int, base_SE3_lidar: SE3) -> RecordedFrame:
        path = self.files[number]
        labelled = self.options.labelled
        fields = _read_arrays(path, _LABELS if labelled else ())
        names = np.atleast_1d(fields.value("names")) if labelled else _NO_BOXES[1]
        boxes = fields.numbers("boxes", (len(names), 7)) if labelled else _NO_BOXES[0]
        ids = ids_of_frame(number, len(names))
        if "ids" in fields and labelled:
            ids = _identities(fields, len(names))
        pose = fields.transform("pose") if "pose" in fields and self.options.odometry != "none" else SE3.identity()
        time_s = fields.number("time_s") if "time_s" in fields else number * self.frame_s
        fov_deg = fields.number("fov_deg") if "fov_deg" in fields and self.options.points == IN_PICTURE else 360.0
        agent = RecordedAgent(pose, base_SE3_lidar, partial(_read_points, path, fov_deg))
        objects = _objects(boxes, names, ids, pose, path)
        return RecordedFrame(
            seconds_to_ns(time_s), dict.fromkeys(self.agents, agent), objects, _doubtful(fields, pose, labelled)
        )


def _sequence_of(path: Path) -> tuple[str, int]:
    """Return the sequence of a file and its number there, such as "queue" and 7 of `queue_07.npz`."""
    match = re.fullmatch(r"(.*?)_?(\d{1,18})", path.stem)
    return (match[1] or path.parent.name, int(match[2])) if match else (path.stem, 0)


def _read_arrays(path: Path, needed: tuple[str, ...]) -> Fields:
    """Return arrays of a file and those that are optional; `Fields` checks them."""
    try:
        return Fields(read_npz(path, MOST_BYTES, (*needed, *_OPTIONAL)), path)
    except _BROKEN as error:
        raise RecordingError(f"{path} is no file of plain arrays: {' '.join(str(error).split())}") from error


def _identities(fields: Fields, count: int) -> Ints:
    ids = np.asarray(fields.value("ids"))
    if ids.shape != (count,) or ids.dtype.kind not in "iu" or len(np.unique(ids)) < count or ids.min(initial=0) < 0:
        raise fields.error("ids", f"must be {count} different integers >= 0")
    return ids.astype(np.int64) + 1


def _doubtful(fields: Fields, world_SE3_file: SE3, labelled: bool) -> Floats:
    """Return boxes (K, 7) in the world frame where an object may be."""
    if "doubtful" not in fields or not labelled:
        return _NO_BOXES[0]
    rows = np.asarray(fields.value("doubtful"))
    boxes = fields.numbers("doubtful", (len(rows) if rows.ndim else 0, 7))
    if boxes[:, 3:6].min(initial=1.0) <= 0:
        raise fields.error("doubtful", "must have lengths, widths and heights > 0")
    return Boxes3D.from_array(boxes).transform(world_SE3_file).array


def _objects(boxes: Floats, names: NDArray[Any], ids: Ints, world_SE3_file: SE3, path: Path) -> RecordedObjects:
    if boxes[:, 3:6].min(initial=1.0) <= 0:
        raise RecordingError(f"{path}: lengths, widths and heights of boxes must be > 0")
    rows = LabelledRows()
    for box, name, key in zip(boxes, names.tolist(), ids.tolist(), strict=True):
        label = class_named(str(name), f"{path}: a box's type")
        if label is not None:
            rows.add(key, box[:3], box[3:6], float(box[6]), label)
    return rows.objects(world_SE3_file)


def _read_points(path: Path, fov_deg: float) -> Sweep:
    points = _checked(_read_arrays(path, ("points",)).value("points"), path)
    seen = np.abs(np.degrees(np.arctan2(points[:, 1], points[:, 0]))) <= fov_deg / 2
    return _sweep(points[seen], SE3.identity())


def _read_cloud(path: Path, base_SE3_lidar: SE3) -> Sweep:
    if path.suffix == ".bin":
        return _sweep(read_float_points(path, 4), base_SE3_lidar)
    try:
        points = read_npy(path, MOST_BYTES)
    except _BROKEN as error:
        raise RecordingError(f"{path} is no file of a plain array: {' '.join(str(error).split())}") from error
    return _sweep(_checked(points, path), base_SE3_lidar)


def _checked(points: NDArray[Any], path: Path) -> NDArray[np.float32]:
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in "iuf":
        raise RecordingError(f"{path}: points must be numbers (N, 3 or more), got {points.dtype} {points.shape}")
    if not np.isfinite(points).all():
        raise RecordingError(f"{path}: all points must be finite")
    return points.astype(np.float32)


def _sweep(points: NDArray[np.float32], base_SE3_file: SE3) -> Sweep:
    bright = points[:, 3] if points.shape[1] > 3 else None
    full_scale = 255.0 if bright is not None and bright.max(initial=0.0) > 1.0 else 1.0
    return sweep_in_base(base_SE3_file, points[:, :3], bright, full_scale)


def _read_boxes(path: Path) -> tuple[Floats, NDArray[Any]]:
    """Read boxes (M, 7) and types (M,) of a text file."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    rows, names = list[list[float]](), list[str]()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        try:
            row = [float(word) for word in words[:7]]
        except ValueError:
            row = []
        if len(words) != 8 or len(row) != 7 or not np.isfinite(row).all():
            raise RecordingError(f"{path}, line {number}: x y z length width height heading type are needed: {line!r}")
        rows.append(row)
        names.append(words[7])
    return np.array(rows, np.float64).reshape(-1, 7), np.array(names, dtype=str)
