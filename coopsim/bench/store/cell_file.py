"""The file of a cell: its result, and all that decided it, as one row of Parquet."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.errors import StoreError

_VALUES = pa.map_(pa.string(), pa.float64())
_SCHEMA = pa.schema(
    [
        ("policy", pa.string()),
        ("scenario", pa.string()),
        ("settings", pa.string()),  # of the condition, as JSON; the next seven are copies for readers
        ("latency_s", pa.float64()),
        ("loss", pa.float64()),
        ("position_noise_m", pa.float64()),
        ("heading_noise_deg", pa.float64()),
        ("bandwidth_bit_s", pa.float64()),
        ("penetration", pa.float64()),
        ("attacks", pa.string()),
        ("seed", pa.int64()),
        ("frames", pa.int64()),
        ("values", _VALUES),
        ("agents", pa.map_(pa.string(), _VALUES)),
        ("rewards", pa.list_(pa.float64())),
        ("messages", pa.map_(pa.string(), pa.int64())),
        ("traceback", pa.string()),
        ("place_seed", pa.int64()),
        ("counts", pa.map_(pa.string(), pa.int64())),
        ("method", pa.string()),
        ("bound", pa.bool_()),
        ("decided_by", pa.string()),
        ("checksum", pa.string()),
    ]
)


def encode(result: CellResult, decided_by: str) -> bytes:
    """Encode a result, and its cell's `fingerprint`, as the content of a file."""
    cell = result.cell
    row = {
        **{name: value for name, value in cell.condition.columns().items() if name in _SCHEMA.names},
        "settings": json.dumps(dict(cell.condition.settings)),
        "policy": cell.policy,
        "seed": cell.seed,
        "frames": cell.frames,
        "values": dict(result.values),
        "agents": {agent: dict(values) for agent, values in result.agents.items()},
        "rewards": result.rewards.tolist(),
        "messages": dict(result.messages),
        "traceback": result.traceback,
        "place_seed": result.place_seed,
        "counts": dict(result.counts),
        "method": result.method,
        "bound": result.bound,
        "decided_by": decided_by,
    }
    table = pa.Table.from_pylist([{**row, "checksum": _checksum(row)}], _SCHEMA)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue())


def decode(content: bytes) -> tuple[CellResult, str]:
    """Decode the content of a file. Return the result and its cell's `fingerprint`.

    Raises:
        StoreError: the content was not made by `encode`, or was changed since.
    """
    try:
        row = _row(content)
        if row.pop("checksum") != _checksum(row):
            raise StoreError("its checksum is another")
        result = CellResult(
            Cell(row["policy"], _condition(row), row["seed"], row["frames"]),
            row["values"],
            row["agents"],
            np.array(row["rewards"], np.float64),
            row["messages"],
            row["traceback"],
            row.get("place_seed"),  # older files lack it, and the next three
            row.get("counts", {}),
            row.get("method", ""),
            bound=row.get("bound", False),
        )
        return replace(result, arithmetic=_arithmetic(row)), str(row["decided_by"])
    except StoreError:
        raise
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        raise StoreError(str(error).splitlines()[0] if str(error) else type(error).__name__) from error


def _condition(row: Mapping[str, Any]) -> Condition:
    """Return the condition of a row; older files have its columns alone."""
    if "settings" in row:
        return Condition(row["scenario"], json.loads(row["settings"]))
    return Condition(**{name: row[name] for name in Condition().columns() if name in row})


def _arithmetic(row: Mapping[str, Any]) -> str:
    """Return the arithmetic of a finished cell, which is part of what decided it."""
    try:
        return "" if row["traceback"] else str(json.loads(row["decided_by"])["code"]["arithmetic"])
    except (ValueError, TypeError, KeyError, RecursionError):  # an older file
        return ""


def _row(content: bytes) -> dict[str, Any]:
    """Read the row as `encode` had it."""
    (row,) = pq.ParquetFile(pa.BufferReader(content)).read(use_threads=False).to_pylist()
    for name in {"values", "agents", "messages", "counts"} & set(row):
        row[name] = dict(row[name])  # a map comes as pairs
    row["agents"] = {agent: dict(values) for agent, values in row["agents"].items()}
    return dict(row)


def _checksum(row: Mapping[str, Any]) -> str:
    """Digest a row. Parquet's own checksums cover its pages, but not the schema that says how to read them."""
    return hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()
