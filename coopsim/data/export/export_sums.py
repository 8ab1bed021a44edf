"""The checksums of an export: every file with its SHA-256, as the command `sha256sum` writes and checks them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator
from pathlib import Path

from coopsim.data.export.problem import Problem
from coopsim.support.files import LOCK, write_whole

SUMS = "SHA256SUMS"


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
