"""Descriptions of logs: lines for people, and plain tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coopsim.data.logs.track_log import TrackLog
from coopsim.errors import LogFileError
from coopsim.support.files import require_writable
from coopsim.types.taxonomy import CLASS_NAMES


def describe_log(log: TrackLog) -> list[str]:
    """Return lines that say what was read, filled and left out."""
    count = np.bincount(log.label, minlength=len(CLASS_NAMES))
    users = ", ".join(f"{number} {name}" for name, number in zip(CLASS_NAMES, count.tolist(), strict=True) if number)
    low, high = log.place[:, :2].min(axis=0), log.place[:, :2].max(axis=0)
    at_once = [len(log.at(time_s)) for time_s in np.linspace(log.start_s, log.end_s, 21).tolist()]
    lines = [
        f"{log.source}: {log.format}",
        f"road users: {len(log.ids)} ({users}); {min(at_once)} to {max(at_once)} at once",
        f"time: {log.start_s:g} to {log.end_s:g} s, a row each {log.step_s:g} s; {len(log.time_s)} rows, "
        f"{int(log.gap.sum())} gaps in tracks",
        f"area: x {low[0]:.0f} to {high[0]:.0f} m, y {low[1]:.0f} to {high[1]:.0f} m",
    ]
    lines += [] if log.owner is None else [f"recorded by: {log.ids[log.owner]}"]
    lines += [f"filled: {text}" for text in log.filled]
    return lines + [f"left out: {number} {what}" for what, number in log.left_out.items()]


def write_table(path: Path, log: TrackLog) -> Path:
    """Write a log as a table with our own columns, CSV or Parquet by the path's end, and return the path.

    Raises:
        LogFileError: the path ends otherwise.
        InvalidValueError: it cannot be written.
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    if path.suffix not in (".csv", ".parquet"):
        raise LogFileError(f"{path}: a table's name must end in .csv or .parquet")
    require_writable(path)
    size = log.size[log.track]
    columns = {
        "time_s": log.time_s,
        "id": np.array(log.ids)[log.track],
        "class": np.array(CLASS_NAMES)[log.label[log.track]],
        **{name: log.place[:, k] for k, name in enumerate(("x_m", "y_m", "z_m"))},
        "heading_rad": log.heading,
        **{name: log.velocity[:, k] for k, name in enumerate(("vx_m_s", "vy_m_s"))},
        **{name: size[:, k] for k, name in enumerate(("length_m", "width_m", "height_m"))},
    }
    table = pa.table({name: pa.array(column) for name, column in columns.items()})
    csv.write_csv(table, path) if path.suffix == ".csv" else parquet.write_table(table, path)
    return path
