"""Files of an entry, which strangers made: what is no regular file inside the folder, or too large, is refused."""

from __future__ import annotations

import hashlib
import itertools
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from coopsim.errors import InvalidValueError, LeaderboardEntryError
from coopsim.support.files import locked, make_folder
from coopsim.support.kernels import is_own_folder

MOST_FILES, MOST_BYTES, MOST_TEXT_BYTES = 1000, 2**30, 2**20
"""Most files and folders of an entry, bytes of all its files, and bytes of a file that is read as text."""

_BLOCK_BYTES = 2**20


def files_of(folder: Path) -> dict[str, Path]:
    """Return the files of a folder and of those in it, hidden ones too, sorted by their names from there.

    Raises:
        LeaderboardEntryError: something is no regular file and no folder, as a link or a pipe; or it is too much.
    """
    found, waiting, count, size = dict[str, Path](), [folder], 0, 0
    while waiting:
        with os.scandir(waiting.pop()) as items:
            listed = list(itertools.islice(items, MOST_FILES + 1))
        for item in listed:
            path, name = Path(item.path), Path(item.path).relative_to(folder).as_posix()
            count += 1
            if not name.isprintable():
                raise LeaderboardEntryError(f"names of files must be of printable characters, got {name!a}")
            if item.is_dir(follow_symlinks=False):
                waiting.append(path)
            elif item.is_file(follow_symlinks=False):
                found[name] = path
                size += item.stat(follow_symlinks=False).st_size
            else:
                raise LeaderboardEntryError(f"{name} must be a regular file, got a link, a pipe or a device")
            if count > MOST_FILES or size > MOST_BYTES:
                raise LeaderboardEntryError(
                    f"an entry must have at most {MOST_FILES} files and {MOST_BYTES:,} bytes, got more, as with {name}"
                )
    return dict(sorted(found.items()))


def read_text(path: Path) -> str:
    """Read a short text file.

    Raises:
        LeaderboardEntryError: it is missing, too large, no regular file, or no UTF-8.
    """
    try:
        content = b"".join(_blocks(path, MOST_TEXT_BYTES))
        return content.decode()
    except UnicodeDecodeError as error:
        raise LeaderboardEntryError(f"cannot read {path}: {error}") from error


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a regular file, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for block in _blocks(path, MOST_BYTES):
        digest.update(block)
    return digest.hexdigest()


def copy_files(files: dict[str, Path], to: Path) -> None:
    """Copy files by their names into a new folder, which every user may read."""
    shutil.rmtree(to, ignore_errors=True)
    make_folder(to)
    to.chmod(0o755)
    for name, path in files.items():
        target = to / name
        for parent in reversed(Path(name).parents[:-1]):
            (to / parent).mkdir(exist_ok=True)
            (to / parent).chmod(0o755)
        with open(target, "xb") as file:
            file.writelines(_blocks(path, MOST_BYTES))
        target.chmod(0o644)


@contextmanager
def work_folder(key: str = "") -> Iterator[Path]:
    """Give a folder for the copy of an entry and for finished cells, and remove it in the end.

    With a key, an interrupted block leaves it for the next one with that key. Raises `InvalidValueError` if another
    process works there.
    """
    if not key:
        with tempfile.TemporaryDirectory(prefix="coopsim-entry-") as made:
            Path(made).chmod(0o711)
            yield Path(made)
        return
    home = Path(tempfile.gettempdir(), f"coopsim-entries-{getattr(os, 'getuid', str)()}")
    home.mkdir(mode=0o711, exist_ok=True)
    if not is_own_folder(home):
        raise InvalidValueError(f"{home} must be a folder of yours that nobody else can write to: remove it")
    work = home / key
    make_folder(work)
    for folder in (home, work):
        folder.chmod(0o711)
    with locked(work):
        yield work
    shutil.rmtree(work)


def _blocks(path: Path, most: int) -> Iterator[bytes]:
    """Yield a regular file's content; a link is not followed, and a pipe not waited for."""
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError as error:
        raise LeaderboardEntryError(f"cannot read {path}: {error.strerror}") from error
    with open(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise LeaderboardEntryError(f"{path} must be a regular file")
        left = most
        while block := file.read(_BLOCK_BYTES):
            left -= len(block)
            if left < 0:
                raise LeaderboardEntryError(f"{path} must have at most {most:,} bytes, got more")
            yield block
