"""Where a benchmark's results lie: a folder with one Parquet file for each finished cell.

It is a cache: a file's name is made from all that decides its content, so any number of grids, versions and commands
may share a folder. Results hold nothing that differs between two runs; seconds, versions and the like stand in a JSON
file beside each.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.bench.grid.cell import CellResult
from coopsim.bench.store.fingerprint import key_of
from coopsim.bench.store.parquet import decode, encode
from coopsim.errors import StoreError
from coopsim.support.files import make_folder, write_durably

CELLS = "cells"
"""Where in its folder they lie."""

_LEFT_BEHIND_S = 3600.0
"""Writing takes milliseconds; a file that is unfinished for as long was left by a command that was killed."""


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
        """The file of a result."""
        return self._cells / f"{key}.parquet"

    def get(self, key: str) -> CellResult | None:
        """The result of that key; None if it is not there.

        Raises:
            StoreError: the file is broken, or is of another key.
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
            raise StoreError(f"{path} is broken: what it says has another key, {key_of(decided_by)}")
        return result

    def put(self, result: CellResult, decided_by: str, circumstances: Mapping[str, Any] | None = None) -> None:
        """Store a result, at once and for good; an older one of the same key is replaced.

        Args:
            result: what is stored.
            decided_by: its `fingerprint`, which makes the key.
            circumstances: what goes into the JSON file beside it.

        Raises:
            InvalidValueError: the file cannot be written.
        """
        path = self.path_of(key_of(decided_by))
        write_durably(path, encode(result, decided_by))
        write_durably(path.with_suffix(".json"), (json.dumps(circumstances or {}, indent=2) + "\n").encode())

    def begin(self, keys: Sequence[str]) -> None:
        """Note what is asked for, so that `results` are of that and not of what else has ever been run here."""
        write_durably(self._grid, (json.dumps({"cells": list(keys)}, indent=2) + "\n").encode())

    def results(self) -> list[CellResult]:
        """What is there of the grid that was asked for last, in its order; of everything, if none was.

        Raises:
            StoreError: names the first file that is broken.
        """
        found = [self.get(key) for key in self._asked()]
        return [result for result in found if result is not None]

    def circumstances(self, key: str) -> dict[str, Any]:
        """What the JSON file beside a result says; empty if it says nothing."""
        try:
            found = json.loads(self.path_of(key).with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):  # nothing depends on it
            return {}
        return found if isinstance(found, dict) else {}

    def _asked(self) -> list[str]:
        try:
            return list(json.loads(self._grid.read_text(encoding="utf-8"))["cells"])
        except FileNotFoundError:
            return sorted(path.stem for path in self._cells.glob("*.parquet"))
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise StoreError(f"{self._grid} is broken: {error}") from error

    def _remove_unfinished(self) -> None:
        for path in self._cells.glob("*.tmp"):
            try:
                if time.time() - path.stat().st_mtime > _LEFT_BEHIND_S:
                    path.unlink()
            except OSError:  # another command was quicker
                continue
