"""Columns that grow without end in bounded memory: what exceeds it waits in a temporary file."""

from __future__ import annotations

import tempfile
import warnings
import weakref
from array import array
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

_MOST_BYTES = 2**20

_WAITING = 64
"""Number of additions that are joined at once, which takes a fraction of the time of one after another."""


class GrowingColumns:
    """Flat columns of numbers, each with its type, that only ever grow.

    The file is opened when it is first needed, in the system's folder for temporary files, and is gone with the object.
    A copy or a pickle holds everything in memory.

    Args:
        codes: type codes of `array` and numpy, by column.
        most_bytes: the most memory of all columns together, the last few additions aside, beyond which they are moved
            to the file.
    """

    def __init__(self, codes: Mapping[str, str], most_bytes: int = _MOST_BYTES) -> None:
        self._most_bytes, self._bytes = most_bytes, 0
        self._types = {name: np.dtype(code) for name, code in codes.items()}
        self._recent = {name: array(code) for name, code in codes.items()}
        self._waiting: dict[str, list[Any]] = {name: [] for name in codes}
        self._additions = 0  # that wait
        self._file: IO[bytes] | None = None
        self._parts: list[dict[str, int]] = []  # of the file: bytes by column, in order

    def append(self, rows: Mapping[str, Any]) -> None:
        """Add values to the end of columns, any number of them to each; they are cast to the columns' types.

        Args:
            rows: values (K,) by column. Arrays are kept for a while: they must not change afterwards.
        """
        for name, values in rows.items():
            self._waiting[name].append(values)
        self._additions += 1
        if self._additions >= _WAITING:
            self._join()

    def column(self, name: str) -> NDArray[Any]:
        """Return a column as a new array of its own type."""
        self._join()
        recent = self._recent[name]
        return np.frombuffer(self._spilled(name) + recent.tobytes(), dtype=recent.typecode).copy()

    def _join(self) -> None:
        """Take in the additions that wait; move all to the file where memory is full."""
        for name, parts in self._waiting.items():
            if parts:
                added = np.concatenate(parts, dtype=self._types[name], casting="unsafe")
                self._recent[name].frombytes(added.tobytes())
                self._bytes += added.nbytes
        self._waiting, self._additions = {name: [] for name in self._recent}, 0
        if self._bytes > self._most_bytes:
            self._spill()

    def _spill(self) -> None:
        """Move all columns to the end of the file. A full disk costs no value: they stay in memory, with a warning."""
        part = {name: column.tobytes() for name, column in self._recent.items()}
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  (closed with the object)
                weakref.finalize(self, self._file.close)
            self._file.seek(sum(sum(sizes.values()) for sizes in self._parts))
            for values in part.values():
                self._write(self._file, values)
        except OSError as error:
            self._most_bytes = np.iinfo(np.int64).max
            warnings.warn(
                f"the log of tracks stays in memory, as no temporary file can be written: {error}", stacklevel=2
            )
            return
        self._parts.append({name: len(values) for name, values in part.items()})
        self._recent = {name: array(column.typecode) for name, column in self._recent.items()}
        self._bytes = 0

    @staticmethod
    def _write(file: IO[bytes], values: bytes) -> None:
        view = memoryview(values)
        while view:
            view = view[file.write(view) :]

    def _spilled(self, name: str) -> bytes:
        """Return the bytes of a column that are in the file."""
        if self._file is None:
            return b""
        found, start = [], 0
        for part in self._parts:
            for each, size in part.items():
                if each == name:
                    self._file.seek(start)
                    found.append(_read(self._file, size))
                start += size
        return b"".join(found)

    def __getstate__(self) -> dict[str, Any]:
        return {"most_bytes": self._most_bytes, "columns": {name: self.column(name) for name in self._recent}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        columns = state["columns"]
        self.__init__({name: values.dtype.char for name, values in columns.items()}, state["most_bytes"])  # type: ignore[misc]
        self.append(columns)


def _read(file: IO[bytes], size: int) -> bytes:
    """Return exactly `size` bytes; a raw file may return fewer at a time."""
    parts: list[bytes] = []
    while size:
        part = file.read(size)
        if not part:
            raise OSError("the temporary file of a log of tracks has been cut short")
        parts.append(part)
        size -= len(part)
    return b"".join(parts)
