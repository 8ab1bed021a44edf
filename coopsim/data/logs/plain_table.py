"""Tables with our own columns: the form to bring any log into.

| column | read as |
|---|---|
| `time_s`, `id`, `x_m`, `y_m` | needed: time, name of the road user, and the middle of its footprint |
| `class` | its type; without the column all are cars |
| `heading_rad` | counter-clockwise from x; else along the way |
| `vx_m_s`, `vy_m_s` | velocity; else from positions |
| `length_m`, `width_m`, `height_m` | size; else that of the class |
| `z_m` | height of the ground; else 0 |
"""

from __future__ import annotations

import numpy as np

from coopsim.data.logs.filling import Columns
from coopsim.data.logs.tables import Table

NEEDED = ("time_s", "id", "x_m", "y_m")


def plain_columns(table: Table) -> Columns:
    """Return the columns of a table."""
    table.need(*NEEDED)
    given = set(table.names)
    sizes = [
        table.numbers(name) if name in given else np.full(table.rows, np.nan)
        for name in ("length_m", "width_m", "height_m")
    ]
    return Columns(
        where=table.first_line,
        time_s=table.numbers("time_s"),
        id=table.texts("id"),
        label=table.classes("class") if "class" in given else np.zeros(table.rows, np.int64),
        xy=table.numbers("x_m", "y_m"),
        z_m=table.numbers("z_m") if "z_m" in given else None,
        heading=table.numbers("heading_rad") if "heading_rad" in given else None,
        velocity=table.numbers("vx_m_s", "vy_m_s") if {"vx_m_s", "vy_m_s"} <= given else None,
        size=np.column_stack(sizes) if {"length_m", "width_m", "height_m"} & given else None,
    )
