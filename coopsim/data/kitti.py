"""KITTI's text formats for detections, labels and poses, as AB3DMOT and V2V4Real use them.

Boxes become ours: x forward, y left, z up, the middle of the box, l, w, h. What their files' axes are is the set's
convention (`AXES`):

- "kitti": camera axes (x right, y down, z forward), y at the *bottom* of the box, rot_y about the downward axis.
- "v2v4real": a LiDAR's x forward, y left and z up in the columns x, z and y, the middle of the box, rot_y about the
  upward axis. Read by "kitti", as the data set's published scores are computed, the ground is turned by a quarter (the
  car drives along -y) and headings and heights are mirrored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.types import Ints, Mask
from coopsim.types.taxonomy import ObjectClass

DETECTION_FIELDS = 15
"""frame, type, x1, y1, x2, y2, score, h, w, l, x, y, z, rot_y, alpha; commas between them."""

LABEL_FIELDS = 17
"""frame id type trunc occ alpha x1 y1 x2 y2 h w l x y z rot_y; spaces between them."""

DETECTION_TYPES = {1: ObjectClass.PEDESTRIAN, 2: ObjectClass.CAR, 3: ObjectClass.BICYCLE}
LABEL_TYPES = {
    "Car": ObjectClass.CAR,
    "Van": ObjectClass.VAN,
    "Truck": ObjectClass.TRUCK,
    "Pedestrian": ObjectClass.PEDESTRIAN,
    "Cyclist": ObjectClass.BICYCLE,
}
UNLABELLED = ("DontCare", "Misc", "Tram", "Person_sitting", "Person")
"""Types of KITTI's labels without an object class of ours."""

LAST_FRAME = 1_000_000
"""A larger frame number is refused: it would be a sequence of more than a day, so it is a mistake."""

ID_LIMIT = 2**53
"""From this size on an object id is refused: ids pass through float64, where neighbours become the same."""

REACH_M = 1e9
"""Largest accepted number of a box or a pose."""

POSE_FIELDS = 12
"""A 3x4 matrix, row by row."""

_ORTHONORMAL = 1e-3  # KITTI writes seven digits

ToBoxes = Callable[[Floats, Floats, Floats], Boxes3D]


def boxes_from_camera(sizes_hwl: Floats, bottoms: Floats, turns_rad: Floats) -> Boxes3D:
    """Convert from "kitti" axes: h, w, l (N, 3), the middle of the bottom x, y, z (N, 3), and rot_y (N,)."""
    height = sizes_hwl[:, 0]
    center = np.column_stack([bottoms[:, 2], -bottoms[:, 0], height / 2 - bottoms[:, 1]])
    return Boxes3D(center, sizes_hwl[:, ::-1], wrap_angle(-turns_rad - np.pi / 2))


def boxes_from_lidar(sizes_hwl: Floats, middles: Floats, turns_rad: Floats) -> Boxes3D:
    """Convert from "v2v4real" axes: h, w, l (N, 3), the middle x, y, z (N, 3) as in the file, and rot_y (N,)."""
    return Boxes3D(middles[:, [0, 2, 1]], sizes_hwl[:, ::-1], wrap_angle(turns_rad))


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """The axes of a set's files.

    Attributes:
        to_boxes: converts sizes, positions and turns of the files to boxes.
        base_from_file: (3, 3) matrix that takes coordinates of the files to our axes.
    """

    to_boxes: ToBoxes
    base_from_file: Floats


AXES = {
    "kitti": Axes(boxes_from_camera, np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    "v2v4real": Axes(boxes_from_lidar, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])),
}
"""Conventions by name, see the module."""

AXES_SE3_CAMERA = SE3(AXES["kitti"].base_from_file, np.zeros(3))
"""From a camera's axes (x right, y down, z forward) to ours (x forward, y left, z up)."""


def read_poses(path: Path, frames: int, axes: str = "kitti") -> list[SE3]:
    """Read `world_SE3_base` of every frame from a file of KITTI's odometry benchmark.

    A line is a frame: 12 numbers, a 3x4 matrix [R | t] row by row, which takes points of the frame's axes to those of
    the first frame, both named as in the set's other files. The base frame is where the files' boxes have their
    origin. With A from those axes to ours, the pose is (A R A^T, A t). Lines of frames after the last one that has
    labels or detections are left out: labels of one class need not go to a sequence's end.

    Raises:
        RecordingError: the file is missing, has fewer lines than `frames`, or a line that is broken.
    """
    rows = _numbers(_fields(path, None, POSE_FIELDS), POSE_FIELDS, path, _check_pose)
    if len(rows) < frames:
        raise RecordingError(f"{path}: a pose for each of {frames} frames is needed, got {len(rows)} lines")
    matrices, turn = rows[:frames].reshape(-1, 3, 4), AXES[axes].base_from_file
    return [SE3(turn @ matrix[:, :3] @ turn.T, turn @ matrix[:, 3]) for matrix in matrices]


def read_detections(path: Path, axes: str = "kitti") -> tuple[Ints, Boxes3D, Floats, Ints]:
    """Read frame (N,), boxes, score (N,) and label (N,) of every line of a detection file; it may be empty.

    Raises:
        RecordingError: the file is missing or has a broken line, which is named.
    """
    rows = _numbers(_fields(path, ",", DETECTION_FIELDS), DETECTION_FIELDS, path, _check_detection)
    codes = rows[:, 1].astype(np.int64)
    label = np.select([codes == code for code in DETECTION_TYPES], [int(cls) for cls in DETECTION_TYPES.values()])
    boxes = AXES[axes].to_boxes(rows[:, 7:10], rows[:, 10:13], rows[:, 13])
    return rows[:, 0].astype(np.int64), boxes, rows[:, 6], label


def read_labels(path: Path, axes: str = "kitti") -> tuple[Ints, Ints, Boxes3D, Ints, int]:
    """Read frame (N,), object id (N,), boxes and label (N,) of every object in a label file, and the last frame.

    Lines of types that are no class of ours are left out, but count for the last frame.

    Raises:
        RecordingError: the file is missing, empty, or has a broken line, which is named.
    """
    fields = _fields(path, None, LABEL_FIELDS)
    if not fields:
        # Most likely an accident, which would silently make every detection of the sequence a false positive.
        raise RecordingError(f"{path} is empty: a sequence without objects has a line of type DontCare")
    return _labels(fields, path, axes)


def read_object_labels(path: Path) -> tuple[Boxes3D, Ints]:
    """Read boxes and label (N,) of every object in a label file of KITTI's object benchmark, which may be empty.

    A line is as in a sequence's label file, without frame and id: 15 fields, with spaces between them.

    Raises:
        RecordingError: the file is missing, or has a broken line, which is named.
    """
    fields = _fields(path, None, LABEL_FIELDS - 2)
    if not fields:
        return Boxes3D.empty(), np.zeros(0, np.int64)
    _, _, boxes, label, _ = _labels([["0", str(row), *parts] for row, parts in enumerate(fields)], path, "kitti")
    return boxes, label


def _labels(fields: Sequence[Sequence[str]], path: Path, axes: str) -> tuple[Ints, Ints, Boxes3D, Ints, int]:
    """Return the objects of lines of 17 fields, see `read_labels`."""
    types = [parts[2] for parts in fields]
    for number, kind in enumerate(types, start=1):
        if kind not in LABEL_TYPES and kind not in UNLABELLED:
            accepted = ", ".join((*LABEL_TYPES, *UNLABELLED))
            raise RecordingError(f"{path}, line {number}: unknown type {kind!r}; accepted: {accepted}")
    numeric = [[*parts[:2], "0", *parts[3:]] for parts in fields]
    rows = _numbers(numeric, LABEL_FIELDS, path, lambda row: _check_label(row, types))
    kept = np.array([kind in LABEL_TYPES for kind in types], dtype=bool)
    label = np.array([int(LABEL_TYPES[kind]) for kind in types if kind in LABEL_TYPES], dtype=np.int64)
    last = int(rows[:, 0].max())
    rows, numbers = rows[kept], np.flatnonzero(kept) + 1
    frame, object_id = rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64)
    _, first = np.unique(np.column_stack([frame, object_id]), axis=0, return_index=True)
    if len(first) < len(rows):
        again = int(np.setdiff1d(np.arange(len(rows)), first)[0])
        raise RecordingError(
            f"{path}, line {numbers[again]}: object {object_id[again]} stands twice in frame {frame[again]}"
        )
    return frame, object_id, AXES[axes].to_boxes(rows[:, 10:13], rows[:, 13:16], rows[:, 16]), label, last


def _fields(path: Path, separator: str | None, width: int) -> list[list[str]]:
    """Split every line into `width` fields; None separates by spaces. Blank lines at the end are left out."""
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path} is not text: {error}") from error
    fields = [line.split(separator) for line in lines]
    for number, (line, parts) in enumerate(zip(lines, fields, strict=True), start=1):
        if not line.strip():
            raise RecordingError(f"{path}, line {number} is blank; blank lines are accepted at the end only")
        if len(parts) != width:
            between = "commas" if separator == "," else "spaces"
            raise RecordingError(
                f"{path}, line {number}: {width} fields with {between} between them are needed, got {len(parts)}"
            )
    return fields


RowCheck = Callable[[Floats], list[tuple[Mask, str]]]


def _check_frame(rows: Floats) -> tuple[Mask, str]:
    frame = rows[:, 0]
    odd: Mask = (frame != np.floor(frame)) | (frame < 0) | (frame > LAST_FRAME)
    return odd, f"the frame must be an integer from 0 to {LAST_FRAME}"


def _check_detection(rows: Floats) -> list[tuple[Mask, str]]:
    known = np.isin(rows[:, 1], list(DETECTION_TYPES))
    types = ", ".join(f"{code} {cls.title}" for code, cls in DETECTION_TYPES.items())
    return [_check_frame(rows), (~known, f"unknown type; accepted: {types}"), *_check_boxes(rows[:, 7:14])]


def _check_label(rows: Floats, types: Sequence[str]) -> list[tuple[Mask, str]]:
    objects = np.array([kind in LABEL_TYPES for kind in types], dtype=bool)
    ids = rows[:, 1]
    problems = [
        *_check_boxes(rows[:, 10:17]),
        (ids != np.floor(ids), "the object id must be an integer"),
        (np.abs(ids) >= ID_LIMIT, f"the object id must be between -{ID_LIMIT} and {ID_LIMIT}, both excluded"),
    ]
    return [_check_frame(rows), *((objects & bad, reason) for bad, reason in problems)]


def _check_pose(rows: Floats) -> list[tuple[Mask, str]]:
    matrices = rows.reshape(-1, 3, 4)
    rotation = matrices[:, :, :3]
    error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0)
    return [
        ((error > _ORTHONORMAL) | (np.linalg.det(rotation) < 0), "the left 3x3 of a pose must be a rotation"),
        (np.abs(matrices[:, :, 3]).max(axis=1) > REACH_M, f"a pose's x, y, z must be in [-{REACH_M:g}, {REACH_M:g}]"),
    ]


def _check_boxes(rows: Floats) -> list[tuple[Mask, str]]:
    """Check h, w, l, x, y, z, rot_y (N, 7)."""
    return [
        (rows[:, :3].min(axis=1) <= 0, "sizes h, w, l must be > 0"),
        (np.abs(rows).max(axis=1) > REACH_M, f"h, w, l, x, y, z, rot_y must be in [-{REACH_M:g}, {REACH_M:g}]"),
    ]


def _numbers(fields: Sequence[Sequence[str]], width: int, path: Path, check: RowCheck) -> Floats:
    """Convert fields to numbers (N, width); an error names the first line that is not as it must be."""
    try:
        rows = np.array(fields, dtype=np.float64).reshape(-1, width)
    except ValueError:
        raise _no_number(fields, path) from None
    finite = np.isfinite(np.abs(rows).max(axis=1))
    for bad, reason in [(~finite, "all fields must be finite numbers"), *(check(rows) if finite.all() else [])]:
        if bad.any():
            raise RecordingError(f"{path}, line {int(np.argmax(bad)) + 1}: {reason}")
    return rows


def _no_number(fields: Sequence[Sequence[str]], path: Path) -> RecordingError:
    for number, parts in enumerate(fields, start=1):
        for part in parts:
            try:
                float(part)
            except ValueError:
                return RecordingError(f"{path}, line {number}: {part!r} is not a number")
    return RecordingError(f"{path}: not all fields are numbers")
