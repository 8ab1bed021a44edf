"""Checks of V2X-Seq-SPD folders: the three lists, and the files that they name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from coopsim.data.export.json_checks import (
    Fields,
    check_fields,
    is_column,
    is_count,
    is_number,
    is_positive,
    is_rotation,
    is_text,
    numbers,
    read_json,
    read_list,
)
from coopsim.data.export.picture_checks import check_picture
from coopsim.data.export.problem import Problem
from coopsim.data.files.pcd import read_pcd
from coopsim.errors import RecordingError

_TYPES = (
    *("Car", "Truck", "Van", "Bus", "Pedestrian", "Cyclist"),
    *("Tricyclist", "Motorcyclist", "Barrowlist", "TrafficCone", "Trafficcone"),
)
_TEXT = is_text, "a text"
_BOX: Fields = {
    "token": _TEXT,
    "track_id": _TEXT,
    "type": (lambda value: value in _TYPES, f"one of {', '.join(_TYPES)}"),
    **{f"3d_dimensions.{name}": (is_positive, "a number of m above 0") for name in "hwl"},
    **{f"3d_location.{name}": (is_number, "a number of m") for name in "xyz"},
    "rotation": (is_number, "a number of radians"),
}
_LABEL: Fields = {
    **_BOX,
    **{f"2d_box.{name}": (is_number, "a number of pixels") for name in ("xmin", "ymin", "xmax", "ymax")},
}
_COOPERATIVE: Fields = {
    **_BOX,
    "from_side": (lambda value: value in ("veh", "inf", "coop"), "veh, inf or coop"),
    **{
        f"{side}_{name}": _TEXT
        for side in ("veh", "inf")
        for name in ("frame_id", "track_id", "token", "pointcloud_timestamp")
    },
}
_RIGID: Fields = {
    "rotation": (is_rotation, "three rows of a rotation"),
    "translation": (is_column, "a column of three numbers of m"),
}
_INTRINSIC: Fields = {"cam_K": (numbers(9), "nine numbers"), "cam_D": (numbers(5), "five numbers")}
_FRAME: Fields = {
    "frame_id": (lambda value: is_text(value) and len(value) == 6 and value.isdecimal(), "a text of six digits"),
    "sequence_id": (lambda value: is_text(value) and len(value) == 4 and value.isdecimal(), "a text of four digits"),
    "pointcloud_timestamp": (lambda value: is_text(value) and value.isdecimal(), "a text of digits, microseconds"),
    "num_frames": (is_count, "a count"),
    "pointcloud_path": _TEXT,
    "label_lidar_std_path": _TEXT,
}
_PAIR: Fields = {
    **dict.fromkeys(("vehicle_frame", "infrastructure_frame", "vehicle_sequence", "infrastructure_sequence"), _TEXT),
    **{f"system_error_offset.delta_{axis}": (is_number, "a number of m") for axis in "xy"},
}
_CALIBRATIONS = {
    "vehicle-side": ("lidar_to_novatel", "novatel_to_world"),
    "infrastructure-side": ("virtuallidar_to_world",),
}


def check_spd(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong in a folder with vehicle-side, infrastructure-side and cooperative."""
    frames: dict[str, set[str]] = {}
    for side, needed in _CALIBRATIONS.items():
        file = f"{side}/data_info.json"
        records, problems = read_list(folder / file, file)
        yield from problems
        frames[side] = set()
        for number, record in enumerate(records):
            found = list(check_fields(record, _FRAME, file, f"[{number}]"))
            yield from found
            if found:
                continue
            if record["frame_id"] in frames[side]:
                yield Problem(file, f"[{number}].frame_id", f"must stand once, got {record['frame_id']} again")
            frames[side].add(record["frame_id"])
            yield from _check_frame(folder, side, record, needed, f"[{number}]")
    yield from _check_pairs(folder, frames)


def _check_frame(
    folder: Path, side: str, record: Mapping[str, Any], needed: tuple[str, ...], where: str
) -> Iterator[Problem]:
    listed = f"{side}/data_info.json"
    for name in needed:
        if not is_text(record.get(f"calib_{name}_path")):
            yield Problem(listed, f"{where}.calib_{name}_path", "must be a text")
    for key, path in record.items():
        if not key.endswith("_path") or not isinstance(path, str) or not path:
            continue
        file = f"{side}/{path}"
        if key == "pointcloud_path":
            try:
                if read_pcd(folder / file).intensity is None:
                    yield Problem(file, "FIELDS", "must have intensity")
            except RecordingError as error:
                yield Problem(file, "", str(error).removeprefix(f"{folder / file}: "))
        elif key == "image_path":
            yield from check_picture(folder / file, file)
        elif key.startswith("label_"):
            yield from _check_labels(folder, file, _LABEL)
        elif key.startswith("calib_"):
            content, reason = read_json(folder / file)
            inside = content.get("transform") if "to_novatel" in key and isinstance(content, Mapping) else content
            fields, where_in = (
                (_INTRINSIC if "intrinsic" in key else _RIGID),
                "transform" if "to_novatel" in key else "",
            )
            yield from [Problem(file, "", reason)] if reason else check_fields(inside, fields, file, where_in)


def _check_pairs(folder: Path, frames: Mapping[str, set[str]]) -> Iterator[Problem]:
    file = "cooperative/data_info.json"
    records, problems = read_list(folder / file, file)
    yield from problems
    for number, record in enumerate(records):
        found = list(check_fields(record, _PAIR, file, f"[{number}]"))
        yield from found
        if found:
            continue
        for side, key in (("vehicle-side", "vehicle_frame"), ("infrastructure-side", "infrastructure_frame")):
            if record[key] not in frames[side]:
                yield Problem(file, f"[{number}].{key}", f"must be a frame of {side}/data_info.json, got {record[key]}")
        yield from _check_labels(folder, f"cooperative/label/{record['vehicle_frame']}.json", _COOPERATIVE)


def _check_labels(folder: Path, file: str, fields: Fields) -> Iterator[Problem]:
    labels, problems = read_list(folder / file, file)
    yield from problems
    seen: set[Any] = set()
    for number, label in enumerate(labels):
        yield from check_fields(label, fields, file, f"[{number}]")
        name = label.get("track_id") if isinstance(label, Mapping) else None
        if isinstance(name, str) and name in seen:
            yield Problem(file, f"[{number}].track_id", f"must stand once in a frame, got {name} again")
        seen.add(name if isinstance(name, str) else None)
