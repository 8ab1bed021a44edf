"""Checks of nuScenes tables: every field, every link between tables, and the files that they name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.export.json_checks import (
    Fields,
    check_fields,
    is_count,
    is_text,
    numbers,
    read_list,
    sizes,
)
from coopsim.data.export.picture_checks import check_picture
from coopsim.data.export.problem import Problem
from coopsim.data.files.float_points import read_float_points
from coopsim.errors import RecordingError

_TEXT = is_text, "a text"
_COUNT = is_count, "an integer >= 0"
_PLACE = numbers(3), "three numbers of m"
_FLAG = (lambda value: isinstance(value, bool)), "true or false"
_NORM = 1e-6


def _is_quaternion(value: Any) -> bool:
    return numbers(4)(value) and abs(float(np.linalg.norm(value)) - 1.0) < _NORM


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


_TURN = _is_quaternion, "a quaternion w, x, y, z of length 1"
_LIST = _is_list, "a list"

TABLES: Mapping[str, Fields] = {
    "category": {"name": _TEXT},
    "attribute": {"name": _TEXT},
    "visibility": {"level": _TEXT},
    "sensor": {
        "channel": _TEXT,
        "modality": (lambda value: value in ("lidar", "camera", "radar"), "lidar, camera or radar"),
    },
    "log": {"logfile": _TEXT, "vehicle": _TEXT, "date_captured": _TEXT, "location": _TEXT},
    "map": {"log_tokens": _LIST, "category": _TEXT, "filename": _TEXT},
    "scene": {"name": _TEXT, "nbr_samples": _COUNT},
    "calibrated_sensor": {"translation": _PLACE, "rotation": _TURN, "camera_intrinsic": _LIST},
    "ego_pose": {"timestamp": _COUNT, "translation": _PLACE, "rotation": _TURN},
    "sample": {"timestamp": _COUNT},
    "sample_data": {
        "timestamp": _COUNT,
        "fileformat": _TEXT,
        "is_key_frame": _FLAG,
        "height": _COUNT,
        "width": _COUNT,
        "filename": _TEXT,
    },
    "sample_annotation": {
        "translation": _PLACE,
        "size": (sizes(3), "width, length and height > 0 m"),
        "rotation": _TURN,
        "attribute_tokens": _LIST,
        "num_lidar_pts": _COUNT,
        "num_radar_pts": _COUNT,
    },
    "instance": {"nbr_annotations": _COUNT},
}
"""Fields of each table beside its token and its links."""

LINKS: Mapping[str, Mapping[str, str]] = {
    "map": {"log_tokens": "log"},
    "scene": {"log_token": "log", "first_sample_token": "sample", "last_sample_token": "sample"},
    "calibrated_sensor": {"sensor_token": "sensor"},
    "sample": {"scene_token": "scene", "prev": "sample", "next": "sample"},
    "sample_data": {
        "sample_token": "sample",
        "ego_pose_token": "ego_pose",
        "calibrated_sensor_token": "calibrated_sensor",
        "prev": "sample_data",
        "next": "sample_data",
    },
    "sample_annotation": {
        "sample_token": "sample",
        "instance_token": "instance",
        "visibility_token": "visibility",
        "attribute_tokens": "attribute",
        "prev": "sample_annotation",
        "next": "sample_annotation",
    },
    "instance": {
        "category_token": "category",
        "first_annotation_token": "sample_annotation",
        "last_annotation_token": "sample_annotation",
    },
}
"""Fields that hold a token of another table, or a list of them."""

_MAY_BE_EMPTY = ("prev", "next")


def check_nuscenes(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong in a folder with tables in `v1.0-...`, `samples` and `sweeps`."""
    versions = sorted(path for path in folder.glob("v1.0-*") if path.is_dir())
    if not versions:
        yield Problem("", "", "there are no tables: DIR must hold a folder v1.0-...")
    for version in versions:
        yield from _check_version(folder, version.name)


def _check_version(folder: Path, version: str) -> Iterator[Problem]:
    tokens: dict[str, set[str]] = {}
    for name in TABLES:  # one table at a time: they may be large
        file = f"{version}/{name}.json"
        records, problems = read_list(folder / file, file)
        yield from problems
        tokens[name] = set()
        for number, record in enumerate(records):
            mine = record.get("token") if isinstance(record, Mapping) else None
            if not (isinstance(mine, str) and mine):
                yield Problem(file, f"[{number}].token", "must be a text")
            elif mine in tokens[name]:
                yield Problem(file, f"[{number}].token", f"must stand once, got {mine} again")
            else:
                tokens[name].add(mine)
            yield from check_fields(record, TABLES[name], file, f"[{number}]")
            if isinstance(record, Mapping) and is_text(record.get("filename")):
                yield from _check_file(folder, record["filename"])
    for name, links in LINKS.items():
        file = f"{version}/{name}.json"
        records, _ = read_list(folder / file, file)
        for number, record in enumerate(records):
            for field, other in links.items() if isinstance(record, Mapping) else ():
                value = record.get(field)
                for each in value if isinstance(value, list) else [value]:
                    if not (each in tokens[other] or (each == "" and field in _MAY_BE_EMPTY)):
                        yield Problem(file, f"[{number}].{field}", f"must be a token of {other}.json, got {each!r}")


def _check_file(folder: Path, name: str) -> Iterator[Problem]:
    path = folder / name
    if name.endswith(".bin"):
        try:
            read_float_points(path, 5)
        except RecordingError as error:
            yield Problem(name, "", str(error).replace(f"{path}: ", "").replace(f"{path}", "the file"))
        return
    yield from check_picture(path, name)
