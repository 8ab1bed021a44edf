"""Checks of KITTI tracking folders, sequence by sequence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from coopsim.data.export.kitti_tracking.oxts_lines import OXTS_FIELDS
from coopsim.data.export.picture_checks import check_picture
from coopsim.data.export.problem import Problem
from coopsim.data.files.float_points import read_float_points
from coopsim.data.kitti import read_labels
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import Floats

_CALIBRATION = {**{f"P{number}": 12 for number in range(4)}, "R_rect": 9, "Tr_velo_cam": 12, "Tr_imu_velo": 12}
_ORTHONORMAL = 1e-4


def check_kitti(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong in a folder with `training/velodyne/<sequence>/<frame>.bin` and what belongs to it."""
    root = folder / "training"
    sequences = sorted(path.name for path in (root / "velodyne").glob("*") if path.is_dir())
    if not sequences:
        yield Problem("", "", "there is no sequence: DIR must hold training/velodyne/<sequence>/<frame>.bin")
    for sequence in sequences:
        for problem in _check_sequence(root, sequence):
            yield Problem(f"training/{problem.file}", problem.field, problem.reason)


def _check_sequence(root: Path, sequence: str) -> Iterator[Problem]:
    scans = sorted((root / "velodyne" / sequence).glob("*.bin"))
    for number, scan in enumerate(scans):
        name = f"velodyne/{sequence}/{scan.name}"
        if scan.stem != f"{number:06d}":
            yield Problem(name, "", f"must be {number:06d}.bin: frames are numbered from 0 without gaps")
            return
        try:
            read_float_points(scan, 4)
        except RecordingError as error:
            yield Problem(name, "", _without(error, scan))
    pictures = root / "image_02" / sequence
    for number in range(len(scans)) if pictures.is_dir() else ():
        name = f"image_02/{sequence}/{number:06d}.png"
        yield from check_picture(root / name, name)
    yield from _check_calibration(root, f"calib/{sequence}.txt")
    yield from _check_oxts(root, f"oxts/{sequence}.txt", len(scans))
    yield from _check_labels(root, f"label_02/{sequence}.txt", len(scans))


def _check_calibration(root: Path, file: str) -> Iterator[Problem]:
    lines = _lines(root / file)
    if isinstance(lines, str):
        yield Problem(file, "", lines)
        return
    rows = {words[0].rstrip(":"): words[1:] for line in lines if (words := line.split())}
    for name, count in _CALIBRATION.items():
        numbers = _numbers(rows.get(name, []))
        if numbers is None or len(numbers) != count:
            yield Problem(file, name, f"must be a line of {count} finite numbers")
        elif not name.startswith("P"):
            turn = numbers.reshape(3, -1)[:, :3]
            if np.abs(turn @ turn.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(turn) < 0:
                yield Problem(file, name, "the left 3 x 3 must be a rotation")


def _check_oxts(root: Path, file: str, frames: int) -> Iterator[Problem]:
    lines = _lines(root / file)
    if isinstance(lines, str):
        yield Problem(file, "", lines)
        return
    if len(lines) != frames:
        yield Problem(file, "", f"must have a line for each of {frames} frames, got {len(lines)}")
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if len(words) != len(OXTS_FIELDS):
            yield Problem(file, f"line {number}", f"must have {len(OXTS_FIELDS)} numbers, got {len(words)}")
            continue
        for field, word in zip(OXTS_FIELDS, words, strict=True):
            if _numbers([word]) is None:
                yield Problem(file, f"line {number}, {field}", f"must be a finite number, got {word!r}")


def _check_labels(root: Path, file: str, frames: int) -> Iterator[Problem]:
    try:
        *_, last = read_labels(root / file)
    except RecordingError as error:
        line = re.match(r"(line \d+)[: ]*(.*)", _without(error, root / file), re.DOTALL)
        yield Problem(file, *line.groups()) if line else Problem(file, "", _without(error, root / file))
        return
    if last >= frames:
        yield Problem(file, "frame", f"must be less than the number of scans, {frames}, got {last}")


def _lines(path: Path) -> list[str] | str:
    """Return the lines of a file, or why there are none."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def _numbers(words: list[str]) -> Floats | None:
    try:
        numbers = np.array(words, np.float64)
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None


def _without(error: RecordingError, path: Path) -> str:
    """Return an error's text without the path at its beginning."""
    return str(error).removeprefix(str(path)).lstrip(",: ")
