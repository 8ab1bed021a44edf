"""Checks of exported folders: checksums, and whether the format's reader takes every file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from coopsim.errors import RecordingError
from coopsim.support.files import LOCK, write_whole

SUMS = "SHA256SUMS"


@dataclass(frozen=True, slots=True)
class Problem:
    """A fault in an exported folder.

    Attributes:
        file: path relative to the folder; empty: the folder as a whole.
        field: key, column or part in the file; empty: the file as a whole, or `reason` names it.
        reason: the fault, and what is accepted.
    """

    file: str
    field: str
    reason: str

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.file, self.field, self.reason)))


def check_by_reading(folder: Path, name: str) -> Iterator[Problem]:
    """Yield the faults at which the reader of recordings of format `name` stops, each once, one a frame at most."""
    # The readers are loaded when something is checked: writing needs none.
    from coopsim.recordings.formats import open_folder

    try:
        opened = open_folder(folder, name=name)
        sequences = [opened.open(each) for each in opened.sequences]
    except RecordingError as error:
        yield _as_problem(folder, error)
        return
    told: set[Problem] = set()
    for sequence in sequences:
        for number in range(sequence.frames):
            try:
                for agent in sequence.frame(number).agents.values():
                    agent.read_sweep()
                    for picture in agent.find_pictures().values():
                        picture.rgb()
            except RecordingError as error:
                problem = _as_problem(folder, error)
                if problem not in told:
                    yield problem
                told.add(problem)


def _as_problem(folder: Path, error: RecordingError) -> Problem:
    """Return an error of reading as the file, relative to the folder, and the rest of its message."""
    before, found, after = str(error).partition(f"{folder}{os.sep}")
    if not found:
        return Problem("", "", str(error))
    place, _, reason = after.partition(": " if ": " in after else " ")
    file, _, line = place.partition(", ")
    return Problem(file, line, ": ".join(filter(None, (before.strip(), reason))))


def write_sums(folder: Path, unlisted: Collection[str]) -> tuple[int, int]:
    """Write the checksums of all files but the unlisted ones. Return their number and size in bytes."""
    lines, size = [], 0
    for path in files_below(folder):
        name = path.relative_to(folder).as_posix()
        if name not in (SUMS, *unlisted):
            lines.append(f"{sha256_of(path)}  {name}\n")
            size += path.stat().st_size
    write_whole(folder / SUMS, "".join(lines))
    return len(lines), size


def check_sums(folder: Path, unlisted: Collection[str]) -> Iterator[Problem]:
    """Yield the files that are missing, were added, or are not as they were exported."""
    try:
        lines = (folder / SUMS).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        yield Problem(SUMS, "", f"cannot be read: {error}")
        return
    sums = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    for name, digest in sums.items():
        if not (folder / name).resolve().is_relative_to(folder.resolve()):
            yield Problem(SUMS, "", f"names a file out of the folder: {name}")
        elif not (folder / name).is_file():
            yield Problem(name, "", "is missing")
        elif sha256_of(folder / name) != digest:
            yield Problem(name, "", f"is not as it was exported: its SHA-256 is another than in {SUMS}")
    for path in files_below(folder):
        name = path.relative_to(folder).as_posix()
        if name not in (SUMS, *sums, *unlisted):
            yield Problem(name, "", f"was added after the export: it is not in {SUMS}")


def files_below(folder: Path) -> Iterator[Path]:
    """Yield all files below a folder but its lock, sorted within each folder."""
    for root, folders, names in os.walk(folder):
        folders.sort()
        yield from (Path(root, name) for name in sorted(names) if name != LOCK)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, read in blocks."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
