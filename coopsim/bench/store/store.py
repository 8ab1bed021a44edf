"""The store of a benchmark: a folder with one Parquet file for each finished cell, and its film if it has one.

It is a cache: the name of a file is a hash of all inputs of its content, so any number of grids, versions and
commands may share a folder. Results hold only data that are the same in every run; seconds, versions and the like are
in a JSON file next to each, and arrays in an NPZ file without pickles.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.grid.cell import CellResult
from coopsim.bench.store.cell_file import decode, encode
from coopsim.bench.store.fingerprint import key_of
from coopsim.errors import StoreError
from coopsim.support.files import make_folder, write_durably

CELLS = "cells"
"""Name of the folder of cells in a store's folder."""

FILMS = "films"
"""Name of the folder of films in it."""

_LEFT_BEHIND_S = 3600.0
"""Age from which an unfinished file was left by a killed command; writing takes milliseconds."""


class Store:
    """Results by key, in `folder/cells`, and films of their runs, in `folder/films`.

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

    def path_of_film(self, key: str) -> Path:
        """Return the path of the film of a result's run."""
        return self.folder / FILMS / f"{key}.npz"

    def get(self, key: str) -> CellResult | None:
        """Return the result of a key, with the path of its film if there is one; None if the store does not have it.

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
        return self._with_film(replace(result, arrays=_read_arrays(arrays)) if arrays.exists() else result, key)

    def put(
        self,
        result: CellResult,
        decided_by: str,
        circumstances: Mapping[str, Any] | None = None,
        film: bytes | None = None,
    ) -> CellResult:
        """Store a result durably, and return it with the path of its film; an older one of the same key is replaced.

        Args:
            result: result of the cell.
            decided_by: the cell's `fingerprint`, which makes the key.
            circumstances: content of the JSON file next to the result.
            film: content of the film's file.

        Raises:
            InvalidValueError: a file cannot be written.
        """
        key = key_of(decided_by)
        path = self.path_of(key)
        if film is not None:  # before the result: what is interrupted in between is run again
            make_folder(self.folder / FILMS)
            write_durably(self.path_of_film(key), film)
        if result.arrays:
            content, arrays = io.BytesIO(), dict[str, Any](result.arrays)
            np.savez_compressed(content, **arrays)
            write_durably(path.with_suffix(".npz"), content.getvalue())
        write_durably(path, encode(result, decided_by))
        write_durably(path.with_suffix(".json"), (json.dumps(circumstances or {}, indent=2) + "\n").encode())
        return self._with_film(result, key)

    def _with_film(self, result: CellResult, key: str) -> CellResult:
        path = self.path_of_film(key)
        return replace(result, film=path) if path.is_file() else result

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

    def all_circumstances(self) -> list[dict[str, Any]]:
        """Read the JSON files next to the results of the latest grid, in its order."""
        return [self.circumstances(key) for key in self._asked()]

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
        for path in (*self._cells.glob("*.tmp"), *(self.folder / FILMS).glob("*.tmp")):
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
