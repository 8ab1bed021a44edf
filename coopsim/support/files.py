"""Files that are written whole or not at all, and their folders, which one process holds at a time."""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Self

from coopsim.errors import InvalidValueError

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LOCK = ".lock"
"""Name of the file in a folder that a process holds; it says which process."""


def require_writable(path: Path) -> None:
    """Raise `InvalidValueError` if a file of this name cannot be written: to be called before long work."""
    target = path.resolve()
    parent = target.parent
    ready = os.access(target, os.W_OK) if _is_special(target) else parent.is_dir() and os.access(parent, os.W_OK)
    if target.is_dir() or not ready:
        raise InvalidValueError(f"cannot write {path}: it must be a file in an existing, writable folder")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, unless they exist; raise `InvalidValueError` if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        files = [place for place in (folder, *folder.parents) if place.is_file()]
        why = f"{files[0]} is a file" if files else error.strerror
        raise InvalidValueError(f"cannot make the folder {folder}: {why}") from error


@contextmanager
def _errors_told(path: str | os.PathLike[str]) -> Iterator[None]:
    """Raise `InvalidValueError` where the system cannot write a file."""
    try:
        yield
    except OSError as error:
        raise InvalidValueError(f"cannot write {path}: {error.strerror}") from error


def write_whole(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file. If that is interrupted, the old file stays, and no temporary file is left.

    A link is followed. A pipe or a device is written to directly. Returns `path`; raises `InvalidValueError`, as all
    here.
    """
    target = Path(path).resolve()
    with _errors_told(path):
        if _is_special(target):
            target.write_text(text, encoding="utf-8")
        else:
            _replace(target, text.encode())
    return Path(path)


def write_whole_bytes(path: Path, content: bytes) -> None:
    """Write a file of bytes whole or not at all, as `write_whole` does with text."""
    with _errors_told(path):
        _replace(path, content)


def write_durably(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; once this returns, it survives even a power failure."""
    with _errors_told(path):
        _replace(path, content, durable=True)
        _sync_folder(path.parent)


class WrittenFiles:
    """Files of a folder that are written in a `with` block, to be made durable together."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._paths = folder, dict[Path, None]()

    def __enter__(self) -> Self:
        self._before = _written.set(self._paths)
        return self

    def __exit__(self, *_: object) -> None:
        _written.reset(self._before)

    def sync(self) -> None:
        """Wait until all that were written since the last call survive a power failure."""
        folders = {parent for path in self._paths for parent in path.parents if parent.is_relative_to(self._folder)}
        with _errors_told(self._folder):
            for path in filter(Path.exists, self._paths):  # parts may have been joined
                with open(path, "rb+") as file:
                    os.fsync(file.fileno())
            for folder in (*folders, self._folder.parent):
                _sync_folder(folder)
        self._paths.clear()


_written: ContextVar[dict[Path, None] | None] = ContextVar("_written", default=None)


def note_written(path: Path) -> None:
    """Add a file that got its name just now to those of the block of `WrittenFiles` that runs, if one does."""
    written = _written.get()
    if written is not None:
        written[path] = None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold an existing folder for this process alone. Without `flock`, as on Windows, nothing is held.

    The lock ends with the process, however that ends. Raises if another process, or another call in this one, holds it.
    """
    if fcntl is None:
        yield
        return
    path = folder / LOCK
    try:
        handle = _lock(path)
    except BlockingIOError:
        holder = path.read_bytes()[:100].decode(errors="replace") if path.exists() else "unknown"
        raise InvalidValueError(
            f"{folder} is in use by process {holder}: wait until it ends, or take another folder"
        ) from None
    except OSError as error:
        raise InvalidValueError(f"cannot write {path}: {error.strerror}") from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _lock(path: Path) -> int:
    """Lock a file and write into it who did. The one that held it may remove it meanwhile: then another is made."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.path.samestat(os.fstat(handle), path.stat()):
                os.ftruncate(handle, 0)
                os.write(handle, f"{os.getpid()} on {socket.gethostname()}".encode())
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _sync_folder(folder: Path) -> None:
    """Make the names in a folder durable, which is a file of its own."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _is_special(target: Path) -> bool:
    return target.exists() and not (target.is_file() or target.is_dir())


def _replace(target: Path, content: bytes, *, durable: bool = False) -> None:
    temporary = target.with_name(f"tmp{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:  # the system itself takes away the rights that the user's mask names
            if target.exists():
                os.chmod(temporary, target.stat().st_mode)
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)  # an interrupt may come after it got its name
        raise
    note_written(target)
