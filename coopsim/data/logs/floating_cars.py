"""Floating car data of SUMO (`--fcd-output`): XML, plain or in gzip, and Parquet.

| attribute | read as |
|---|---|
| `timestep time`, `vehicle id`, `person id` | time, and names |
| `x`, `y` | the middle of the **front**, m: the footprint's lies half a length behind |
| `angle` | degrees clockwise from north |
| `speed` | m/s along the heading |
| `type` | the class, where a word of it names one, such as `bus`; else a car, of persons a pedestrian |

Sizes are in no such file: those of the classes are taken, but cars have the 5 m that SUMO gives them.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.logs.filling import SIZES_M, Columns
from coopsim.data.logs.floating_lines import NUMBERS, ROOT, USERS, FloatingRows, regular_rows
from coopsim.data.logs.tables import Table
from coopsim.data.maps.elements import Start, read_starts
from coopsim.errors import LogFileError, MapFileError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass

PARQUET = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle", "vehicle_speed")

_WORDS = (
    *((word, ObjectClass.TRUCK) for word in ("truck", "trailer", "lkw", "semi")),
    *((word, ObjectClass.BUS) for word in ("bus", "coach")),
    *((word, ObjectClass.VAN) for word in ("van", "delivery", "ambulance")),
    *((word, ObjectClass.MOTORCYCLE) for word in ("motorcycle", "moped", "motorbike")),
    *((word, ObjectClass.BICYCLE) for word in ("bicycle", "bike", "cyclist")),
    *((word, ObjectClass.SCOOTER) for word in ("scooter",)),
    *((word, ObjectClass.PEDESTRIAN) for word in ("pedestrian", "person", "ped_")),
)
_CAR_M = (5.0, 1.8, 1.5)


def floating_columns(path: Path) -> Columns:
    """Return the columns of an XML file."""
    rows = regular_rows(path) or _rows(path)
    names = np.array(rows.names, str)
    order = np.argsort(names)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    columns = _columns(("vehicle", 1), rank[rows.name], rows.types, rows.type, rows.numbers)
    return replace(columns, names=names[order])


def floating_table_columns(table: Table) -> Columns:
    """Return the columns of a Parquet file, which has vehicles only."""
    types = table.texts("vehicle_type") if "vehicle_type" in table.names else np.full(table.rows, "")
    given, number = np.unique(types, return_inverse=True)
    names = ("timestep_time", "vehicle_x", "vehicle_y", "vehicle_angle", "vehicle_speed")
    return _columns(table.first_line, table.texts("vehicle_id"), given.tolist(), number, table.numbers(*names))


def _rows(path: Path) -> FloatingRows:
    """Return the rows of any XML file, element by element."""
    names: dict[str, int] = {}
    types: dict[str, int] = {}
    texts, numbers = array("q"), array("d")  # flat: files have millions of rows
    time_s = 0.0
    for tag, attributes in _starts(path):
        try:
            if tag == "timestep":
                time_s = float(attributes["time"])
            elif tag in USERS:
                x, y, angle, speed = map(attributes.__getitem__, NUMBERS)
                numbers.extend((time_s, float(x), float(y), float(angle), float(speed)))
                texts.append(names.setdefault(attributes["id"], len(names)))
                texts.append(types.setdefault(attributes.get("type", USERS[tag]), len(types)))
        except (KeyError, ValueError) as error:
            wrong = f"lacks {error.args[0]}" if isinstance(error, KeyError) else str(error)
            name = f" id={attributes.get('id', '')!r} at {time_s:g} s" if tag in USERS else ""
            raise LogFileError(f"{path}: <{tag}{name}>: {wrong}") from None
    number = np.frombuffer(texts, np.int64).reshape(-1, 2)
    return FloatingRows([*names], [*types], number[:, 0], number[:, 1], np.frombuffer(numbers).reshape(-1, 5))


def _starts(path: Path) -> Iterator[Start]:
    """Yield all elements of a file after its root."""
    try:
        elements = read_starts(path)
        root = next(elements, ("", {}))[0]
        if root != ROOT:
            raise LogFileError(f"{path} is no floating car data: its root must be <{ROOT}>, got <{root}>")
        yield from elements
    except MapFileError as error:
        raise LogFileError(str(error)) from None


def heading_and_velocity(angle_deg: Floats, speed_m_s: Floats) -> tuple[Floats, Floats]:
    """Return headings (N,) rad and velocities (N, 2) m/s, from angles (N,) clockwise from north and speeds (N,)."""
    heading = np.pi / 2 - np.radians(angle_deg)
    return heading, speed_m_s[:, None] * np.column_stack([exact.cos(heading), exact.sin(heading)])


def _columns(where: tuple[str, int], ids: NDArray[Any], types: list[str], type_: Ints, numbers: Floats) -> Columns:
    time_s, x, y, angle, speed = numbers.T
    heading, velocity = heading_and_velocity(angle, speed)
    label = np.array([_label(name) for name in types], np.int64)[type_]
    usual = np.array([_CAR_M if k == ObjectClass.CAR else SIZES_M[k] for k in ObjectClass])
    return Columns(
        where=where,
        time_s=time_s,
        id=ids,
        label=label,
        xy=np.column_stack([x, y]),
        heading=heading,
        velocity=velocity,
        size=usual[label],
        front=True,
    )


def _label(name: str) -> int:
    """Return the class that a word of a type names."""
    return next((int(label) for word, label in _WORDS if word in name.lower()), int(ObjectClass.CAR))
