"""KITTI's text formats for detections and labels, as AB3DMOT and V2V4Real use them.

Both give boxes in camera axes (x right, y down, z forward), with y at the *bottom* of the box, sizes as h, w, l, and
the turn about the downward axis. Here they become ours: x forward, y left, z up, the middle of the box, l, w, h.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from coopsim.errors import RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
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
"""Types that stand in KITTI's labels and are no object class of ours."""

LAST_FRAME = 1_000_000
"""A larger frame number is refused: it would be a sequence of more than a day, so it is a mistake."""

ID_LIMIT = 2**53
"""From this size on an object id is refused: ids pass through float64, where neighbours become the same."""

REACH_M = 1e9
"""Boxes have no number larger than this."""


def boxes_from_camera(sizes_hwl: Floats, bottoms: Floats, turns_rad: Floats) -> Boxes3D:
    """Boxes in our axes from h, w, l (N, 3), the middle of the bottom x, y, z (N, 3), and rot_y (N,)."""
    height = sizes_hwl[:, 0]
    center = np.column_stack([bottoms[:, 2], -bottoms[:, 0], height / 2 - bottoms[:, 1]])
    return Boxes3D(center, sizes_hwl[:, ::-1], wrap_angle(-turns_rad - np.pi / 2))


def read_detections(path: Path) -> tuple[Ints, Boxes3D, Floats, Ints]:
    """Frame (N,), boxes, score (N,) and label (N,) of every line of a detection file; it may be empty.

    Raises:
        RecordingError: the file is missing or has a broken line, which is named.
    """
    rows = _numbers(_fields(path, ",", DETECTION_FIELDS), DETECTION_FIELDS, path, _check_detection)
    codes = rows[:, 1].astype(np.int64)
    label = np.select([codes == code for code in DETECTION_TYPES], [int(cls) for cls in DETECTION_TYPES.values()])
    boxes = boxes_from_camera(rows[:, 7:10], rows[:, 10:13], rows[:, 13])
    return rows[:, 0].astype(np.int64), boxes, rows[:, 6], label


def read_labels(path: Path) -> tuple[Ints, Ints, Boxes3D, Ints, int]:
    """Frame (N,), object id (N,), boxes and label (N,) of every object in a label file, and the last frame.

    Lines of types that are no class of ours are left out, but count for the last frame.

    Raises:
        RecordingError: the file is missing, empty, or has a broken line, which is named.
    """
    fields = _fields(path, None, LABEL_FIELDS)
    if not fields:
        # Most likely an accident, which would silently make every detection of the sequence a false positive.
        raise RecordingError(f"{path} is empty: a sequence without objects has a line of type DontCare")
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
    return frame, object_id, boxes_from_camera(rows[:, 10:13], rows[:, 13:16], rows[:, 16]), label, last


def _fields(path: Path, separator: str | None, width: int) -> list[list[str]]:
    """The fields of every line, `width` each; None separates by spaces. Blank lines at the end are left out."""
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


def _check_detection(rows: Floats) -> list[tuple[Mask, str]]:
    known = np.isin(rows[:, 1], list(DETECTION_TYPES))
    types = ", ".join(f"{code} {cls.title}" for code, cls in DETECTION_TYPES.items())
    return [(~known, f"unknown type; accepted: {types}"), *_check_boxes(rows[:, 7:14])]


def _check_label(rows: Floats, types: Sequence[str]) -> list[tuple[Mask, str]]:
    objects = np.array([kind in LABEL_TYPES for kind in types], dtype=bool)
    ids = rows[:, 1]
    problems = [
        *_check_boxes(rows[:, 10:17]),
        (ids != np.floor(ids), "the object id must be an integer"),
        (np.abs(ids) >= ID_LIMIT, f"the object id must be between -{ID_LIMIT} and {ID_LIMIT}, both excluded"),
    ]
    return [(objects & bad, reason) for bad, reason in problems]


def _check_boxes(rows: Floats) -> list[tuple[Mask, str]]:
    """Of h, w, l, x, y, z, rot_y."""
    return [
        (rows[:, :3].min(axis=1) <= 0, "sizes h, w, l must be > 0"),
        (np.abs(rows).max(axis=1) > REACH_M, f"h, w, l, x, y, z, rot_y must be in [-{REACH_M:g}, {REACH_M:g}]"),
    ]


def _numbers(fields: Sequence[Sequence[str]], width: int, path: Path, check: RowCheck) -> Floats:
    """All fields as numbers (N, width); the first line that is not as it must be is named."""
    try:
        rows = np.array(fields, dtype=np.float64).reshape(-1, width)
    except ValueError:
        raise _no_number(fields, path) from None
    frame = rows[:, 0]
    odd_frame: Mask = (frame != np.floor(frame)) | (frame < 0) | (frame > LAST_FRAME)
    problems: list[tuple[Mask, str]] = [
        (~np.isfinite(np.abs(rows).max(axis=1)), "all fields must be finite numbers"),
        (odd_frame, f"the frame must be an integer from 0 to {LAST_FRAME}"),
        *check(rows),
    ]
    for bad, reason in problems:
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
