"""Clips as files: the compressed arrays of `coopsim.learn.clips.clip_arrays` (npz)."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

from numpy.lib import format as npy
from numpy.typing import NDArray

from coopsim.errors import RecordingError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_arrays import Arrays, arrays_of, clip_of
from coopsim.support.files import write_durably

_LEVEL = 3  # of deflate: higher ones take several times as long for 3 %
_LARGEST_BYTES = 4 * 2**30  # of a file's arrays: what says it has more is broken
_DAY = (1980, 1, 1, 0, 0, 0)  # no clock: the same clip gives the same file
_BROKEN = (
    *(OSError, ValueError, KeyError, IndexError, TypeError, EOFError, ArithmeticError, MemoryError),
    *(RuntimeError, NotImplementedError, struct.error, zipfile.BadZipFile, zlib.error),
)
"""What reading a broken file may raise: all that zipfile and numpy do."""


def save_clip(path: Path, clip: Clip) -> None:
    """Write a clip whole or not at all; its points are rounded as those of `SimulatedClips` are already.

    Raises:
        InvalidValueError: the file cannot be written, or the clip has no frames or points beyond 327 m.
    """
    write_durably(path, clip_bytes(clip))


def load_clip(path: Path) -> Clip:
    """Read a clip.

    Raises:
        RecordingError: the file is missing or broken; names it.
    """
    try:
        return clip_of(_read(path))
    except _BROKEN as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        why = f"it has no array {error}" if isinstance(error, KeyError) else why
        raise RecordingError(f"{path} is no clip: {why}") from error


def clip_bytes(clip: Clip) -> bytes:
    """Return the content of a clip's file; errors as `save_clip`."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive:
        for name, array in arrays_of(clip).items():
            member = io.BytesIO()
            npy.write_array(member, array, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", _DAY)
            archive.writestr(entry, member.getvalue(), zipfile.ZIP_DEFLATED, _LEVEL)
    return packed.getvalue()


def _read(path: Path) -> Arrays:
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > _LARGEST_BYTES:
            raise ValueError("its arrays are too large")
        names = archive.namelist()
        return {name.removesuffix(".npy"): _member(archive, name) for name in names}


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    content = archive.read(name)
    array: NDArray[Any] = npy.read_array(io.BytesIO(content), allow_pickle=False)
    return array
