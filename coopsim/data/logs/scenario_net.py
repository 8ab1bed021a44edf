"""Pickles of ScenarioNet and MetaDrive: one scenario each, of Waymo, nuPlan, nuScenes and others.

| part | read as |
|---|---|
| `tracks.<id>.state.position`, `heading`, `velocity`, `valid`, `length`, `width`, `height` | arrays over time |
| `tracks.<id>.type` | `VEHICLE` is a car, or by its length a truck; `TRAFFIC_CONE` and such are left out |
| `metadata.ts`, `metadata.sdc_id` | times, s, and the car that recorded; older: `ts` and `sdc_index` |
| older MetaDrive: `state` | columns x, y, z, length, width, height, heading, vx, vy, valid |

`position` is the middle of the box, so the ground is half a height below. Rows that are not valid are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.logs.arrays_only import Word, read_arrays
from coopsim.data.logs.filling import Columns
from coopsim.data.logs.tables import TYPES, label_of
from coopsim.errors import LogFileError
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass

_OLD_COLUMNS = 10
_OLD_TYPES = {1: "car", 2: "pedestrian", 3: "bicycle"}
_CLASSES = {"vehicle": "car", "cyclist": "bicycle", "traffic_barrier": "barrier", "unset": "unknown"}
_TRUCK_M = 7.0
"""Least length of a vehicle that is a truck: these files do not tell them from cars."""


def scenario_columns(path: Path) -> Columns:
    """Return the columns of a scenario.

    Raises:
        LogFileError: the file is missing, broken or hostile, or has no tracks; names the track.
    """
    content = read_arrays(path)
    if not (isinstance(content, dict) and isinstance(content.get("tracks"), dict) and content["tracks"]):
        raise LogFileError(f"{path} has no tracks; accepted: a scenario of ScenarioNet or MetaDrive")
    given = content.get("metadata")
    about: Mapping[str, Any] = given if isinstance(given, dict) else {}
    times = np.asarray(_numbers(content["ts"] if "ts" in content else about.get("ts"), f"{path}: ts", (None,)))
    parts: list[Floats] = []
    labels: list[int] = []
    names: list[str] = []
    for key, track in content["tracks"].items():
        where = f"{path}: track {key}"
        if not isinstance(track, dict):
            raise LogFileError(f"{where} must be a dictionary with type and state")
        rows = _rows(track.get("state"), where, len(times))
        kind = _type(track.get("type"))
        label = label_of(kind, _CLASSES)
        if label is None:
            raise LogFileError(f"{where} must be {TYPES}, got {kind!r}")
        if label == ObjectClass.CAR and rows[:, 3].max(initial=0.0) >= _TRUCK_M:
            label = int(ObjectClass.TRUCK)
        valid = rows[:, 9] > 0
        parts.append(np.column_stack([times, rows])[valid])
        labels += [label] * int(valid.sum())
        names += [str(key)] * int(valid.sum())
    table = np.concatenate(parts)
    size = np.where(table[:, 4:7] > 0, table[:, 4:7], np.nan)
    owner = content.get("sdc_index", about.get("sdc_id"))
    return Columns(
        where=("valid row", 1),
        time_s=table[:, 0],
        id=np.array(names, str),
        label=np.array(labels, np.int64),
        xy=table[:, 1:3],
        z_m=table[:, 3] - 0.5 * np.nan_to_num(size[:, 2]),
        heading=table[:, 7],
        velocity=table[:, 8:10],
        size=size,
        step_s=float(np.round(np.median(np.diff(times)), 6)) if len(times) > 1 else None,
        owner=None if owner is None else str(owner),
    )


def _type(given: Any) -> str:
    if isinstance(given, Word):
        return _OLD_TYPES.get(given.value, "unknown") if isinstance(given.value, int) else "unknown"
    return str(given)


def _rows(state: Any, where: str, count: int) -> Floats:
    """Return the states (T, 10) of a track: x, y, z, length, width, height, heading, vx, vy, valid."""
    if not isinstance(state, Mapping):
        return _numbers(state, f"{where}, state", (count, _OLD_COLUMNS))
    columns = [_numbers(state.get("position"), f"{where}, position", (count, 3))]
    for name in ("length", "width", "height"):
        size = state.get(name)
        columns.append(np.zeros((count, 1)) if size is None else _numbers(size, f"{where}, {name}", (count, 1)))
    columns.append(_numbers(state.get("heading"), f"{where}, heading", (count, 1)))
    columns.append(_numbers(state.get("velocity"), f"{where}, velocity", (count, 2)))
    columns.append(_numbers(state.get("valid"), f"{where}, valid", (count, 1)))
    return np.hstack(columns)


def _numbers(given: Any, where: str, shape: tuple[int | None, ...]) -> Floats:
    """Return an array as float64 of this shape; of one column (T,) is accepted as (T, 1)."""
    try:
        array = np.asarray(given, np.float64)
    except (TypeError, ValueError):
        array = np.zeros(())
    if len(shape) == 2 and shape[1] == 1 and array.ndim == 1:
        array = array[:, None]
    fits = len(array.shape) == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if not fits or not array.size:
        wanted = " x ".join("any" if n is None else str(n) for n in shape)
        raise LogFileError(f"{where} must be numbers of shape {wanted}, got {_shape(given)}")
    return array


def _shape(given: Any) -> str:
    return "nothing" if given is None else f"{type(given).__name__} {getattr(given, 'shape', '')}".strip()
