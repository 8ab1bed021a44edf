"""The store of a benchmark: a folder with one Parquet file for each finished cell.

It is a cache: the name of a file is a hash of all inputs of its content, so any number of grids, versions and
commands may share a folder. Results hold only data that are the same in every run; seconds, versions and the like are
in a JSON file next to each, and arrays in an NPZ file without pickles.
"""

from __future__ import annotations

import hashlib
import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.store.fingerprint import key_of
from coopsim.errors import StoreError
from coopsim.support.files import make_folder, write_durably

CELLS = "cells"
"""Name of the folder of cells in a store's folder."""

_LEFT_BEHIND_S = 3600.0
"""Age from which an unfinished file was left by a killed command; writing takes milliseconds."""


class Store:
    """Results by key, in `folder/cells`.

    Raises:
        InvalidValueError: the folder cannot be made.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._cells, self._grid = self.folder / CELLS, self.folder / "grid.json"
        make_folder(self._cells)
        self._remove_unfinished()

    def path_of(self, key: str) -> Path:
        """Return the path of a result's file."""
        return self._cells / f"{key}.parquet"

    def get(self, key: str) -> CellResult | None:
        """Return the result of a key; None if the store does not have it.

        Raises:
            StoreError: the file is broken, or has another key.
        """
        path = self.path_of(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StoreError(f"{path} cannot be read: {error.strerror}") from error
        try:
            result, decided_by = decode(content)
        except StoreError as error:
            raise StoreError(f"{path} is broken: {error}") from error
        if key_of(decided_by) != key:
            raise StoreError(f"{path} is broken: its content has another key, {key_of(decided_by)}")
        arrays = path.with_suffix(".npz")
        return replace(result, arrays=_read_arrays(arrays)) if arrays.exists() else result

    def put(self, result: CellResult, decided_by: str, circumstances: Mapping[str, Any] | None = None) -> None:
        """Store a result durably; an older one of the same key is replaced.

        Args:
            result: result of the cell.
            decided_by: the cell's `fingerprint`, which makes the key.
            circumstances: content of the JSON file next to the result.

        Raises:
            InvalidValueError: the file cannot be written.
        """
        path = self.path_of(key_of(decided_by))
        if result.arrays:
            content, arrays = io.BytesIO(), dict[str, Any](result.arrays)
            np.savez_compressed(content, **arrays)
            write_durably(path.with_suffix(".npz"), content.getvalue())
        write_durably(path, encode(result, decided_by))
        write_durably(path.with_suffix(".json"), (json.dumps(circumstances or {}, indent=2) + "\n").encode())

    def begin(self, keys: Sequence[str], provenance: Mapping[str, Any] | None = None) -> None:
        """Note the keys of the current grid, so that `results` leaves out those of other grids, and its provenance."""
        noted = {"cells": list(keys), "provenance": provenance}
        write_durably(self._grid, (json.dumps(noted, indent=2) + "\n").encode())

    def asked(self) -> int:
        """Return the number of cells of the latest grid; without a grid, of all results."""
        return len(self._asked())

    def provenance(self) -> dict[str, Any] | None:
        """Return what the latest grid was made from, as it was given to `begin`; None if nothing was.

        Raises:
            StoreError: the file is broken.
        """
        if not self._grid.exists():
            return None
        found = self._noted().get("provenance")
        return dict(found) if isinstance(found, Mapping) else None

    def results(self, *, all_grids: bool = False) -> list[CellResult]:
        """Return the stored results of the latest grid, in its order; without a grid, all results.

        With `all_grids` they are those of all grids in the folder; of a cell that was run by several versions, the
        newest.

        Raises:
            StoreError: a file is broken; the message names the first one.
        """
        found = [self.get(key) for key in (self._by_age() if all_grids else self._asked())]
        known = [result for result in found if result is not None]
        return list({result.cell: result for result in known}.values()) if all_grids else known

    def circumstances(self, key: str) -> dict[str, Any]:
        """Read the JSON file next to a result; empty if it is missing or broken."""
        try:
            found = json.loads(self.path_of(key).with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # no result depends on it
            return {}
        return found if isinstance(found, dict) else {}

    def _by_age(self) -> list[str]:
        """Return the keys of all results, the oldest first."""
        return [path.stem for path in sorted(self._cells.glob("*.parquet"), key=lambda path: path.stat().st_mtime_ns)]

    def _asked(self) -> list[str]:
        if not self._grid.exists():
            return sorted(path.stem for path in self._cells.glob("*.parquet"))
        return list(self._noted()["cells"])

    def _noted(self) -> dict[str, Any]:
        """Read the file of the latest grid."""
        try:
            noted = json.loads(self._grid.read_text(encoding="utf-8"))
            return {**noted, "cells": list(noted["cells"])}
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise StoreError(f"{self._grid} is broken: {error}") from error

    def _remove_unfinished(self) -> None:
        for path in self._cells.glob("*.tmp"):
            try:
                if time.time() - path.stat().st_mtime > _LEFT_BEHIND_S:
                    path.unlink()
            except OSError:  # another command was quicker
                continue


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
            return dict(arrays)
    except Exception as error:  # a changed byte makes zipfile, zlib and numpy raise almost anything
        raise StoreError(f"{path} is broken: {type(error).__name__}: {error}") from error


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
