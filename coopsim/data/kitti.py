"""KITTI's text formats for detections and labels, as AB3DMOT and V2V4Real use them.

Both give boxes in camera axes (x right, y down, z forward), with y at the *bottom* of the box, sizes as h, w, l, and
the turn about the downward axis. Here they become ours: x forward, y left, z up, the middle of the box, l, w, h.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.taxonomy import ObjectClass
from coopsim.types import Ints

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
"""Types that stand in KITTI's labels and are no object class of ours."""


def boxes_from_camera(sizes_hwl: Floats, bottoms: Floats, turns_rad: Floats) -> Boxes3D:
    """Boxes in our axes from h, w, l (N, 3), the middle of the bottom x, y, z (N, 3), and rot_y (N,)."""
    height = sizes_hwl[:, 0]
    center = np.column_stack([bottoms[:, 2], -bottoms[:, 0], height / 2 - bottoms[:, 1]])
    return Boxes3D(center, sizes_hwl[:, ::-1], wrap_angle(-turns_rad - np.pi / 2))


def read_detections(path: Path) -> tuple[Ints, Boxes3D, Floats, Ints]:
    """Frame (N,), boxes, score (N,) and label (N,) of every line of a detection file.

    Raises:
        RecordingError: the file is missing or has a broken line, which is named.
    """
    lines = _lines(path)
    rows = _numbers([line.split(",") for line in lines], DETECTION_FIELDS, path, _check_detection)
    codes = rows[:, 1].astype(np.int64)
    label = np.select([codes == code for code in DETECTION_TYPES], [int(cls) for cls in DETECTION_TYPES.values()])
    boxes = boxes_from_camera(rows[:, 7:10], rows[:, 10:13], rows[:, 13])
    return rows[:, 0].astype(np.int64), boxes, rows[:, 6], label


def read_labels(path: Path) -> tuple[Ints, Ints, Boxes3D, Ints, int]:
    """Frame (N,), object id (N,), boxes and label (N,) of every object in a label file, and the last frame.

    Lines of types that are no class of ours are left out, but count for the last frame (-1 if there is no line).

    Raises:
        RecordingError: the file is missing or has a broken line, which is named.
    """
    fields = [line.split() for line in _lines(path)]
    types = [parts[2] if len(parts) > 2 else "" for parts in fields]
    for number, kind in enumerate(types, start=1):
        if kind not in LABEL_TYPES and kind not in UNLABELLED:
            accepted = ", ".join((*LABEL_TYPES, *UNLABELLED))
            raise RecordingError(f"{path}, line {number}: unknown type {kind!r}; accepted: {accepted}")
    numeric = [[*parts[:2], "0", *parts[3:]] for parts in fields]
    rows = _numbers(numeric, LABEL_FIELDS, path, lambda row: _check_label(row, types))
    kept = np.array([kind in LABEL_TYPES for kind in types], dtype=bool)
    label = np.array([int(LABEL_TYPES[kind]) for kind in types if kind in LABEL_TYPES], dtype=np.int64)
    last = int(rows[:, 0].max(initial=-1))
    rows, numbers = rows[kept], np.flatnonzero(kept) + 1
    frame, object_id = rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64)
    _, first = np.unique(np.column_stack([frame, object_id]), axis=0, return_index=True)
    if len(first) < len(rows):
        again = int(np.setdiff1d(np.arange(len(rows)), first)[0])
        raise RecordingError(
            f"{path}, line {numbers[again]}: object {object_id[again]} stands twice in frame {frame[again]}"
        )
    return frame, object_id, boxes_from_camera(rows[:, 10:13], rows[:, 13:16], rows[:, 16]), label, last


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path} is not text: {error}") from error


Mask = NDArray[np.bool_]
RowCheck = Callable[[Floats], list[tuple[Mask, str]]]


def _check_detection(rows: Floats) -> list[tuple[Mask, str]]:
    known = np.isin(rows[:, 1], list(DETECTION_TYPES))
    types = ", ".join(f"{code} {cls.title}" for code, cls in DETECTION_TYPES.items())
    return [
        (~known, f"unknown type; accepted: {types}"),
        (rows[:, 7:10].min(axis=1) <= 0, "sizes h, w, l must be > 0"),
    ]


def _check_label(rows: Floats, types: Sequence[str]) -> list[tuple[Mask, str]]:
    objects = np.array([kind in LABEL_TYPES for kind in types], dtype=bool)
    return [
        (objects & (rows[:, 10:13].min(axis=1) <= 0), "sizes h, w, l must be > 0"),
        (objects & (rows[:, 1] != np.floor(rows[:, 1])), "the object id must be an integer"),
    ]


def _numbers(fields: Sequence[Sequence[str]], width: int, path: Path, check: RowCheck) -> Floats:
    """All fields as numbers (N, width); the first line that is not as it must be is named."""
    try:
        rows = np.array(fields, dtype=np.float64) if fields else np.zeros((0, width))
    except ValueError:
        raise _broken_line(fields, width, path) from None
    if rows.shape[1] != width:
        raise _broken_line(fields, width, path)
    odd_frame: Mask = rows[:, 0] != np.abs(np.floor(rows[:, 0]))
    problems: list[tuple[Mask, str]] = [
        (~np.isfinite(rows.sum(axis=1)), "all fields must be finite numbers"),
        (odd_frame, "the frame must be an integer >= 0"),
        *check(rows),
    ]
    for bad, reason in problems:
        if bad.any():
            raise RecordingError(f"{path}, line {int(np.argmax(bad)) + 1}: {reason}")
    return rows


def _broken_line(fields: Sequence[Sequence[str]], width: int, path: Path) -> RecordingError:
    for number, parts in enumerate(fields, start=1):
        if len(parts) != width:
            return RecordingError(f"{path}, line {number}: {width} fields are needed, got {len(parts)}")
        for part in parts:
            try:
                value = float(part)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                return RecordingError(f"{path}, line {number}: {part!r} is not a finite number")
    return RecordingError(f"{path}: the lines are not {width} numbers each")
