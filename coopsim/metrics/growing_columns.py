"""Columns that grow without end in bounded memory: what exceeds it waits in a temporary file."""

from __future__ import annotations

import os
import tempfile
import warnings
import weakref
from array import array
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_MOST_BYTES = 2**20

_WAITING = 64
"""Number of additions that are joined at once, which takes a fraction of the time of one after another."""


class _File:
    """A temporary file by its number, closed when nothing refers to it any more."""

    def __init__(self) -> None:
        opened = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115  (closed below)
        self.number = opened.fileno()
        weakref.finalize(self, opened.close)


class Spool:
    """A temporary file for the columns of one or several logs, opened when it is first written to.

    It lies in the system's folder for temporary files, and is gone with the object. After a fork parent and child go on
    in files of their own, and both read what was written before.
    """

    def __init__(self) -> None:
        self._file: _File | None = None
        self._end = self._process = 0

    def write(self, content: bytes) -> Place:
        """Add bytes, and return where they are.

        Raises:
            OSError: the file cannot be made, or the disk is full. Nothing was added.
        """
        if self._file is None or self._process != os.getpid():
            self._file = _File()
            self._end, self._process = 0, os.getpid()
        place, left = Place(self._file, self._end, len(content)), memoryview(content)
        while left:
            left = left[_write_at(self._file.number, left, place.start + len(content) - len(left)) :]
        self._end += len(content)
        return place


class Place(NamedTuple):
    """Bytes in a spool's file."""

    file: _File
    start: int
    length: int

    def read(self) -> bytes:
        """Return the bytes."""
        parts, done = [], 0
        while done < self.length:  # the system may read fewer at a time
            part = _read_at(self.file.number, self.length - done, self.start + done)
            if not part:
                raise OSError("the temporary file of a log of tracks has been cut short")
            parts.append(part)
            done += len(part)
        return b"".join(parts)


def _read_at(number: int, length: int, start: int) -> bytes:
    if hasattr(os, "pread"):
        return os.pread(number, length, start)
    os.lseek(number, start, os.SEEK_SET)  # Windows
    return os.read(number, length)


def _write_at(number: int, content: memoryview, start: int) -> int:
    if hasattr(os, "pwrite"):
        return os.pwrite(number, content, start)
    os.lseek(number, start, os.SEEK_SET)  # Windows
    return os.write(number, content)


class GrowingColumns:
    """Flat columns of numbers, each with its type, that only ever grow.

    A copy or a pickle holds everything in memory.

    Args:
        codes: type codes of `array` and numpy, by column.
        spool: the file for what memory does not hold; None: one of its own.
        most_bytes: the most memory of all columns together, the last few additions aside, beyond which they are moved
            to the file.
    """

    def __init__(self, codes: Mapping[str, str], spool: Spool | None = None, most_bytes: int = _MOST_BYTES) -> None:
        self._most_bytes, self._bytes = most_bytes, 0
        self._types = {name: np.dtype(code) for name, code in codes.items()}
        self._recent = {name: array(code) for name, code in codes.items()}
        self._waiting: dict[str, list[Any]] = {name: [] for name in codes}
        self._additions = 0  # that wait
        self._spool = Spool() if spool is None else spool
        self._spilled: dict[str, list[Place]] = {name: [] for name in codes}

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
        whole = b"".join([*(place.read() for place in self._spilled[name]), recent.tobytes()])
        return np.frombuffer(whole, dtype=recent.typecode).copy()

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
        """Move all columns to the file. A full disk costs no value: they stay in memory, with a warning."""
        part = {name: column.tobytes() for name, column in self._recent.items()}
        try:
            whole = self._spool.write(b"".join(part.values()))
        except OSError as error:
            self._most_bytes = np.iinfo(np.int64).max
            warnings.warn(
                f"the log of tracks stays in memory, as no temporary file can be written: {error}", stacklevel=2
            )
            return
        start = whole.start
        for name, values in part.items():
            self._spilled[name].append(Place(whole.file, start, len(values)))
            start += len(values)
        self._recent = {name: array(column.typecode) for name, column in self._recent.items()}
        self._bytes = 0

    def __getstate__(self) -> dict[str, Any]:
        return {"most_bytes": self._most_bytes, "columns": {name: self.column(name) for name in self._recent}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        columns = state["columns"]
        codes = {name: values.dtype.char for name, values in columns.items()}
        self.__init__(codes, most_bytes=state["most_bytes"])  # type: ignore[misc]
        self.append(columns)
