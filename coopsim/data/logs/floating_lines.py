"""Floating car data as SUMO writes it, an element in a line, as tables: ten times as fast as element by element.

Lines of vehicles are cut at quotation marks. Then every other column is the same in all of them, ` x=` for example, and
the others are the values. Files that differ in anything are left to the reader of XML, with all its messages.
"""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coopsim.data.logs.filling import MOST_ROWS
from coopsim.data.logs.tables import MOST_BYTES
from coopsim.data.maps.elements import opened, starts_of
from coopsim.errors import MapFileError
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

ROOT = "fcd-export"
USERS = {"vehicle": "", "person": "pedestrian"}
"""Tags of road users, and their types where none is given."""
NUMBERS = ("x", "y", "angle", "speed")

BLOCK_BYTES = 16 << 20
_LONGEST_STEP = 64 << 20
_STEP, _END, _PERSON = b"<timestep ", b"</timestep>", b"<person "
_OPENING = re.compile(rb'time="([0-9.]+)"\s*(/?)>')
_ATTRIBUTE = re.compile(r"([A-Za-z]+)=")


class FloatingRows(NamedTuple):
    """The N rows of a file, in its order.

    Attributes:
        names, types: the different names and types of road users.
        name, type: (N,) those of each row, by their numbers.
        numbers: (N, 5) time (s), x and y (m), angle (degrees) and speed (m/s).
    """

    names: list[str]
    types: list[str]
    name: Ints
    type: Ints
    numbers: Floats


class _IrregularError(Exception):
    """The file is not as SUMO writes it."""


def regular_rows(path: Path) -> FloatingRows | None:
    """Return the rows of a file that is as SUMO writes it; None: it is not, or is damaged."""
    steps = _Steps()
    try:
        header, footer = steps.read(path)
        tags = [tag for tag, _ in starts_of(str(path), header, footer)]
    except (_IrregularError, MapFileError, OSError, EOFError, zlib.error, ValueError):
        return None
    return steps.rows() if tags[:1] == [ROOT] and not {"timestep", *USERS} & {*tags} else None


class _Steps:
    """Rows of the time steps that were read."""

    def __init__(self) -> None:
        self._names: dict[str, int] = {}
        self._types: dict[str, int] = {}
        self._parts: list[tuple[Ints, Ints, Floats]] = []

    def rows(self) -> FloatingRows:
        """Return all rows."""
        name, type_, numbers = (np.concatenate(column) for column in zip(*self._parts, strict=True))
        return FloatingRows([*self._names], [*self._types], name, type_, numbers)

    def read(self, path: Path) -> tuple[bytes, bytes]:
        """Read a file; return the text before its first and after its last step."""
        header, rest = b"", b""
        read = count = 0
        with opened(path) as file:
            while block := file.read(BLOCK_BYTES):
                read += len(block)
                first, *steps = (rest + block).split(_STEP)
                header += first
                rest = _STEP + steps.pop() if steps else b""
                count += self._take(steps)
                if len(rest) + len(header) > _LONGEST_STEP or read > MOST_BYTES or count > MOST_ROWS:
                    raise _IrregularError
        last, end, footer = rest.removeprefix(_STEP).partition(_END)
        self._take([last + end])
        return header, footer

    def _take(self, steps: list[bytes]) -> int:
        """Take the rows of steps, each the text after `<timestep `; return how many there are."""
        opened_steps = [_open_step(step) for step in steps]
        found, step_of = [], []
        for k, tag in enumerate(USERS):
            texts = [lines[k] for _, lines in opened_steps]
            part = self._table(tag, b"".join(texts))
            counts = [text.count(b"<") for text in texts]
            if sum(counts) != len(part[0]):
                raise _IrregularError
            found.append(part)
            step_of.append(np.repeat(np.arange(len(steps)), counts))
        order = np.argsort(np.concatenate(step_of), kind="stable")
        name, type_, numbers = (np.concatenate(column)[order] for column in zip(*found, strict=True))
        numbers[:, 0] = np.array([time_s for time_s, _ in opened_steps])[np.concatenate(step_of)[order]]
        self._parts.append((name, type_, numbers))
        return len(name)

    def _table(self, tag: str, text: bytes) -> tuple[Ints, Ints, Floats]:
        """Return names, types and numbers, but for the times, of lines of one tag."""
        if not text:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 5))
        cells = text[: text.index(b"\n")].decode("ascii").split('"')
        names = _attributes(tag, cells[::2])
        table = _split(text, len(cells), names)
        for k, cell in enumerate(cells[::2]):
            if table[f"between {k}"].combine_chunks().dictionary.to_pylist() != [cell]:
                raise _IrregularError
        numbers = np.zeros((table.num_rows, 5))
        for k, name in enumerate(NUMBERS, 1):
            numbers[:, k] = table[name].to_numpy()
        types = _numbered(table["type"], self._types) if "type" in names else self._usual(tag, table.num_rows)
        return _numbered(table["id"], self._names), types, numbers

    def _usual(self, tag: str, count: int) -> Ints:
        return np.full(count, self._types.setdefault(USERS[tag], len(self._types)))


def _open_step(step: bytes) -> tuple[float, tuple[bytes, bytes]]:
    """Return the time of a step, and its lines of vehicles and of persons."""
    opening = _OPENING.match(step)
    if opening is None:
        raise _IrregularError
    lines, end, after = step[opening.end() :].partition(_END)
    if after.strip() or (lines.strip() or end if opening[2] else not end):
        raise _IrregularError
    person = lines.find(_PERSON)
    cut = len(lines) if person < 0 else lines.rfind(b"\n", 0, person) + 1
    return float(opening[1]), (_as_lines(lines[:cut]), _as_lines(lines[cut:]))


def _as_lines(text: bytes) -> bytes:
    if b"&" in text or not text.isascii():
        raise _IrregularError
    lines = text.rstrip().lstrip(b"\r\n")
    return lines + b"\n" if lines else b""


def _attributes(tag: str, between: list[str]) -> list[str]:
    """Return the names of a line's attributes, from what stands between their values."""
    opening, *others = (each.strip(" ") for each in between)
    found = [_ATTRIBUTE.fullmatch(each) for each in (opening.removeprefix(f"<{tag} "), *others[:-1])]
    names = [each[1] for each in found if each is not None]
    regular = len(names) == len(found) == len({*names}) and others[-1:] == ["/>"]
    if not (regular and {"id", *NUMBERS} <= {*names}):
        raise _IrregularError
    return names


def _split(text: bytes, cells: int, names: list[str]) -> Any:
    """Return lines as a table: numbers, names, and what stands between the values."""
    import pyarrow as pa
    from pyarrow import csv

    word = pa.dictionary(pa.int32(), pa.string())
    columns = [names[k // 2] if k % 2 else f"between {k // 2}" for k in range(cells)]
    types = {name: pa.float64() if name in NUMBERS else word for name in columns}
    wanted = [name for name in columns if name in ("id", "type", *NUMBERS) or name.startswith("between")]
    return csv.read_csv(
        pa.py_buffer(text),
        csv.ReadOptions(use_threads=False, block_size=len(text) + 1, column_names=columns),
        csv.ParseOptions(delimiter='"', quote_char=False, double_quote=False, ignore_empty_lines=False),
        csv.ConvertOptions(column_types=types, include_columns=wanted, null_values=[]),
    )


def _numbered(column: Any, known: dict[str, int]) -> Ints:
    """Return the numbers (N,) of a column's words, and number those that are not known."""
    words = column.combine_chunks()
    numbers = [known.setdefault(word, len(known)) for word in words.dictionary.to_pylist()]
    found: Ints = np.array(numbers, np.int64)[words.indices.to_numpy()]
    return found
