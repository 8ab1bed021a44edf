"""Tables of logs: CSV, plain or in gzip, and Parquet, by pyarrow, column by column."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.recordings.labelled_rows import find_class
from coopsim.errors import LogFileError
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

MOST_BYTES = 4 << 30

TYPES = "a type of road user (car, van, truck, bus, motorcycle, bicycle, scooter, pedestrian, child, ...)"


class Table:
    """A table of a file: its columns as numbers, texts or classes.

    Args:
        path: a CSV or Parquet file.

    Attributes:
        path: the file.
        names: names of its columns.
        rows: number of rows.
        first_line: word for a row in a message, "line" or "row", and the number of the first.

    Raises:
        LogFileError: the file is missing, no such table, cut off or too large.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._table = _read(path)
        self.names: tuple[str, ...] = tuple(self._table.column_names)
        self.rows: int = self._table.num_rows
        self.first_line = ("row", 1) if path.suffix == ".parquet" else ("line", 2)

    def need(self, *names: str) -> None:
        """Raise an error unless the table has these columns."""
        missing = [name for name in names if name not in self.names]
        if missing:
            there = ", ".join(self.names[:40])
            raise LogFileError(f"{self.path} has no column {', '.join(missing)}; there are: {there}")

    def numbers(self, *names: str) -> Floats:
        """Return columns (N, len(names)) as numbers, nan where a field is empty; one column as (N,)."""
        self.need(*names)
        columns = np.column_stack([self._number(name) for name in names])
        return columns[:, 0] if len(names) == 1 else columns

    def texts(self, name: str) -> NDArray[Any]:
        """Return a column (N,) as it is: integers, or texts."""
        self.need(name)
        column = self._table[name].combine_chunks()
        if column.null_count:
            row = int(np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))[0])
            raise self._error(name, row, "must not be empty")
        values: NDArray[Any] = column.to_numpy(zero_copy_only=False)
        if values.dtype.kind in "iub":
            return values.astype(np.int64)
        texts = values.astype(str)
        if (texts == "").any():
            raise self._error(name, int(np.argmax(texts == "")), "must not be empty")
        return texts

    def classes(self, name: str, own: Mapping[str, str] | None = None) -> Ints:
        """Return the labels (N,) of a column of types' names; -1 of what is no road user.

        Args:
            name: name of the column.
            own: the format's own names, with one that is known for each.
        """
        given, number = np.unique(self.texts(name).astype(str), return_inverse=True)
        labels = np.empty(len(given), np.int64)
        for k, word in enumerate(given.tolist()):
            found = label_of(word, own)
            if found is None:
                raise self._error(name, int(np.argmax(number == k)), f"must be {TYPES}, got {word!r}")
            labels[k] = found
        return labels[number]

    def _number(self, name: str) -> Floats:
        column = self._table[name].combine_chunks()
        try:
            return np.asarray(column.cast("float64").to_numpy(zero_copy_only=False), np.float64)
        except Exception as error:  # pyarrow's own, of many kinds
            for row, value in enumerate(column.to_pylist()):
                try:
                    float("nan" if value is None else value)
                except (TypeError, ValueError):
                    raise self._error(name, row, f"must be a number, got {value!r}") from None
            raise LogFileError(f"{self.path}: column {name} must be numbers") from error

    def _error(self, name: str, row: int, wrong: str) -> LogFileError:
        word, first = self.first_line
        return LogFileError(f"{self.path}: {word} {row + first}, column {name} {wrong}")


def label_of(word: str, own: Mapping[str, str] | None = None) -> int | None:
    """Return the label of a type's name, -1 if it is no road user; None: it is not known.

    Args:
        word: the name.
        own: the format's own names, with one that is known for each.
    """
    try:
        found = find_class((own or {}).get(word.lower(), word))
    except KeyError:
        return None
    return -1 if found is None else int(found)


def _read(path: Path) -> Any:
    import pyarrow as pa
    from pyarrow import csv, parquet

    try:
        if path.stat().st_size > MOST_BYTES:
            raise LogFileError(f"{path} has more than the {MOST_BYTES >> 30} GB that are accepted")
        if path.suffix == ".parquet":
            return parquet.read_table(path, memory_map=False)
        return csv.read_csv(path)
    except FileNotFoundError:
        raise LogFileError(f"no file {path}") from None
    except (OSError, pa.ArrowException) as error:
        said = str(error).splitlines()[0][:200]
        raise LogFileError(f"{path} is no table, or is cut off: {said}") from error
