"""Tables of INTERACTION and of Argoverse 2's motion forecasting, and SUMO's floating car data as Parquet.

| format | column | read as |
|---|---|---|
| INTERACTION | `timestamp_ms`, `track_id`, `x`, `y`, `vx`, `vy` | ms, names, m, m/s |
| | `psi_rad`, `length`, `width` | of vehicles; people and riders have none |
| | `agent_type` | `pedestrian/bicycle` is not told apart: a bicycle, where it is faster than 2.5 m/s, else a person |
| | `case_id` | of files with many cases one is read, the first if none is named |
| Argoverse 2 | `timestep` | steps of 0.1 s |
| | `position_x`, `position_y`, `heading`, `velocity_x`, `velocity_y` | m, rad, m/s |
| | `object_type` | `static`, `background`, `construction`, `riderless_bicycle` and `unknown` are left out |
| | `track_id` | `AV` is the car that recorded |
"""

from __future__ import annotations

import numpy as np

from coopsim.data.logs.filling import Columns
from coopsim.data.logs.tables import Table
from coopsim.errors import LogFileError
from coopsim.geometry import exact
from coopsim.types.taxonomy import ObjectClass

INTERACTION = ("track_id", "timestamp_ms", "agent_type", "x", "y")
ARGOVERSE = ("track_id", "timestep", "object_type", "position_x", "position_y")

_EITHER = "pedestrian/bicycle"
_FASTER_M_S = 2.5
_STEP_S = 0.1

_STILL = dict.fromkeys(("static", "background", "construction", "riderless_bicycle"), "other")
_FORECAST_CLASSES = {"vehicle": "car", **_STILL}


def interaction_columns(table: Table, case: int | None = None) -> Columns:
    """Return the columns of a table of INTERACTION.

    Args:
        table: the table.
        case: number of the case that is read; None: the first.

    Raises:
        LogFileError: a column is missing or broken, or there is no such case.
    """
    table.need(*INTERACTION)
    chosen = np.ones(table.rows, bool)
    if "case_id" in table.names:
        cases = table.numbers("case_id")
        number = float(cases[0]) if case is None and len(cases) else case
        chosen = cases == number
        if not chosen.any():
            raise LogFileError(f"{table.path} has no case {case}; it has {int(cases.min())} to {int(cases.max())}")
    names, track = np.unique(table.texts("track_id"), return_inverse=True)
    velocity = table.numbers("vx", "vy") if {"vx", "vy"} <= set(table.names) else None
    label = table.classes("agent_type", {_EITHER: "pedestrian"})
    if velocity is not None:
        fastest = np.zeros(len(names))
        np.maximum.at(fastest, track, np.where(chosen, exact.norm(velocity), 0.0))
        either = np.char.lower(table.texts("agent_type").astype(str)) == _EITHER
        label[either & (fastest[track] > _FASTER_M_S)] = int(ObjectClass.BICYCLE)
    given = set(table.names)
    unknown = np.full(table.rows, np.nan)
    size = [table.numbers(name) if name in given else unknown for name in ("length", "width")]
    columns = Columns(
        where=table.first_line,
        time_s=table.numbers("timestamp_ms") / 1e3,
        id=table.texts("track_id"),
        label=np.where(chosen, label, -1),
        xy=table.numbers("x", "y"),
        heading=table.numbers("psi_rad") if "psi_rad" in given else None,
        velocity=velocity,
        size=np.column_stack([*size, unknown]),
        step_s=_STEP_S,
    )
    if not chosen.all():
        columns.left_out["rows of other cases"] = int((~chosen).sum())
    return columns


def argoverse_columns(table: Table) -> Columns:
    """Return the columns of a scenario of Argoverse 2."""
    table.need(*ARGOVERSE)
    return Columns(
        where=table.first_line,
        time_s=table.numbers("timestep") * _STEP_S,
        id=table.texts("track_id").astype(str),
        label=table.classes("object_type", _FORECAST_CLASSES),
        xy=table.numbers("position_x", "position_y"),
        heading=table.numbers("heading"),
        velocity=table.numbers("velocity_x", "velocity_y"),
        step_s=_STEP_S,
        owner="AV",
    )
