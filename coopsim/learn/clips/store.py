"""Clips as files, the compressed arrays of `coopsim.learn.clips.arrays` (npz), and folders that cache them."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from numpy.lib import format as npy

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.learn.clips.arrays import arrays_of, clip_of
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.support.checks import require_count
from coopsim.support.files import make_folder, write_durably, write_whole
from coopsim.support.plain_arrays import read_npz

_SUFFIX = ".npz"
_SOURCE = "source.txt"
_LEVEL = 3  # of deflate: higher ones take several times as long for 3 %
_LARGEST_BYTES = 4 * 2**30  # of a file's arrays: a file that names more is broken
_DAY = (1980, 1, 1, 0, 0, 0)  # no clock: the same clip gives the same file
_BROKEN = (
    *(OSError, ValueError, KeyError, IndexError, TypeError, EOFError, ArithmeticError, MemoryError),
    *(RuntimeError, NotImplementedError, struct.error, zipfile.BadZipFile, zlib.error),
)
"""Errors of reading a broken file: all that zipfile and numpy raise."""


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
        return clip_of(read_npz(path, _LARGEST_BYTES))
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


@dataclass(frozen=True, slots=True)
class CachedClips:
    """Clips of a source, each made once and kept in a folder, which is made unless it exists.

    Several processes may share the folder: two that make the same clip at once write the same file. The `repr` of the
    source must say all that decides its clips, as that of `SimulatedClips` does.

    Raises:
        InvalidValueError: the folder cannot be written, or holds clips of another source.
    """

    source: ClipSource
    folder: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", Path(self.folder))
        make_folder(self.folder)
        note, mine = self.folder / _SOURCE, f"{self.source!r}\n"
        if not note.exists():
            write_whole(note, mine)
        elif (kept := note.read_text(encoding="utf-8")) != mine:
            raise InvalidValueError(f"{self.folder} holds clips of another source, {kept.strip()}, not {mine.strip()}")

    def path(self, index: int) -> Path:
        """Return the path of a clip's file."""
        return self.folder / f"{index:08d}{_SUFFIX}"

    def clip(self, index: int) -> Clip:
        """Return a clip from the folder, or from the source if it is not there yet (or broken)."""
        require_count(0, index=index)
        path = self.path(index)
        if path.exists():
            try:
                return load_clip(path)
            except RecordingError:
                pass  # made anew, as anything that a cache lost
        made: Clip = self.source.clip(index)
        save_clip(path, made)
        return made
