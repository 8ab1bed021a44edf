"""JSON lists of records that grow over many episodes without being held in memory.

Records wait as lines in a folder `.parts`, one file per list and episode, until the export ends and they are joined.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.data.export.export_format import LineFile
from coopsim.errors import InvalidValueError
from coopsim.support.files import make_folder

Record = Mapping[str, Any]

FIRST_US = 1_000_000_000_000_000
"""Time stamp of every episode's first frame: readers take 0 for a missing one."""


class RecordParts:
    """Lists of an export: JSON files in its folder, named without suffix, as "v1.0-trainval/sample"."""

    def __init__(self, folder: Path, lists: Sequence[str]) -> None:
        self._folder, self._lists = folder, tuple(lists)
        self._parts, self._done = folder / ".parts", folder / ".parts-done"
        self._open: dict[str, LineFile] = {}

    def begin_episode(self, episode: str) -> None:
        """Begin the lists' part of an episode; what an interrupted one left is overwritten."""
        make_folder(self._parts)
        self._open = {name: LineFile(self._part(name, episode)) for name in self._lists}

    def append(self, name: str, records: Sequence[Record]) -> None:
        """Append records to a list."""
        self._open[name].append(*(as_line(record) for record in records))

    def end_episode(self) -> None:
        """End the episode's part."""
        for file in self._open.values():
            file.close()

    def join(self, episodes: Sequence[str]) -> None:
        """Write the lists, with the parts of all episodes in order, and remove the parts. May be called again.

        Raises:
            InvalidValueError: a file cannot be read or written.
        """
        try:
            if self._parts.is_dir():
                for name in self._lists:
                    self._join(name, episodes)
                os.replace(self._parts, self._done)  # at once: after an interruption all parts are there, or none
            shutil.rmtree(self._done, ignore_errors=True)
        except OSError as error:
            raise InvalidValueError(f"cannot join the records of {self._folder}: {error.strerror or error}") from error

    def _join(self, name: str, episodes: Sequence[str]) -> None:
        make_folder((self._folder / name).parent)
        whole = LineFile(self._folder / f"{name}.json")
        waiting = "["
        for episode in episodes:
            with self._part(name, episode).open(encoding="utf-8") as lines:
                for batch in _batches(lines):
                    whole.append(waiting, *(f"{line}," for line in batch[:-1]))
                    waiting = f"{batch[-1]},"
        whole.append(waiting.removesuffix(","), "]")
        whole.close()

    def _part(self, name: str, episode: str) -> Path:
        return self._parts / f"{episode}.{name.replace('/', '.')}.jsonl"


def token(*parts: object) -> str:
    """Return an identifier of 32 hexadecimal digits that is the same for the same parts."""
    return hashlib.sha256(" ".join(map(str, parts)).encode()).hexdigest()[:32]


def as_line(record: Record) -> str:
    """Return a record as JSON in one line."""
    return json.dumps(record, separators=(",", ":"), allow_nan=False)


def _batches(lines: Iterator[str] | Any, size: int = 1000) -> Iterator[list[str]]:
    batch: list[str] = []
    for line in lines:
        batch.append(line.rstrip("\n"))
        if len(batch) == size:
            yield batch
            batch = []
    if batch:
        yield batch
