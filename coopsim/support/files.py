"""Files that are written whole or not at all, and their folders."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from coopsim.errors import InvalidValueError


def require_writable(path: Path) -> None:
    """Raise `InvalidValueError` if a file of this name cannot be written: to be called before long work."""
    target = path.resolve()
    parent = target.parent
    ready = os.access(target, os.W_OK) if _is_special(target) else parent.is_dir() and os.access(parent, os.W_OK)
    if target.is_dir() or not ready:
        raise InvalidValueError(f"cannot write {path}: it must be a file in an existing, writable folder")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, unless they exist.

    Raises:
        InvalidValueError: the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        files = [place for place in (folder, *folder.parents) if place.is_file()]
        why = f"{files[0]} is a file" if files else error.strerror
        raise InvalidValueError(f"cannot make the folder {folder}: {why}") from error


def write_whole(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file. If that is interrupted, the old file stays, and no temporary file is left.

    A link is followed. A pipe or a device is written to directly. Returns `path`.

    Raises:
        InvalidValueError: the file cannot be written.
    """
    target = Path(path).resolve()
    try:
        if _is_special(target):
            target.write_text(text, encoding="utf-8")
        else:
            _replace(target, text.encode())
    except OSError as error:
        raise InvalidValueError(f"cannot write {path}: {error.strerror}") from error
    return Path(path)


def write_whole_bytes(path: Path, content: bytes) -> None:
    """Write a file of bytes whole or not at all, as `write_whole` does with text.

    Raises:
        InvalidValueError: the file cannot be written.
    """
    try:
        _replace(path, content)
    except OSError as error:
        raise InvalidValueError(f"cannot write {path}: {error.strerror}") from error


def write_durably(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; once this returns, it survives even a power failure.

    Raises:
        InvalidValueError: the file cannot be written.
    """
    try:
        _replace(path, content, durable=True)
        if hasattr(os, "O_DIRECTORY"):  # the new name is in the folder, which is a file of its own
            folder = os.open(path.parent, os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except OSError as error:
        raise InvalidValueError(f"cannot write {path}: {error.strerror}") from error


def _is_special(target: Path) -> bool:
    return target.exists() and not (target.is_file() or target.is_dir())


def _replace(target: Path, content: bytes, *, durable: bool = False) -> None:
    handle, temporary = tempfile.mkstemp(dir=target.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(handle)
        os.chmod(temporary, target.stat().st_mode if target.exists() else 0o666 & ~_umask())
        os.replace(temporary, target)
    except BaseException:
        os.unlink(temporary)
        raise


def _umask() -> int:
    mask = os.umask(0)  # it can be read only by setting it
    os.umask(mask)
    return mask
