"""Folders of clips: made once and kept, or somebody's own samples."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_file import load_clip, save_clip
from coopsim.support.checks import require_count
from coopsim.support.files import make_folder, write_whole

_SUFFIX = ".npz"
_SOURCE = "source.txt"


class ClipSource(Protocol):
    """Something that has clips by number, as `SimulatedClips`."""

    def clip(self, index: int) -> Clip:
        """Return a clip: the same for the same index."""


class StoredClips:
    """The clips of a folder, in the order of their files' names, over and over.

    Args:
        folder: with files of `save_clip`; those that come later are not seen.

    Raises:
        RecordingError: there is no clip.
    """

    def __init__(self, folder: str | Path) -> None:
        self._paths = sorted(Path(folder).glob(f"*{_SUFFIX}"))
        if not self._paths:
            raise RecordingError(f"{folder} must be a folder with clips (files {'*' + _SUFFIX}), and has none")

    def __len__(self) -> int:
        return len(self._paths)

    def clip(self, index: int) -> Clip:
        """Return the clip of number `index % len(self)`.

        Raises:
            InvalidValueError: the index is no count.
            RecordingError: the file is broken; names it.
        """
        require_count(0, index=index)
        return load_clip(self._paths[index % len(self._paths)])


@dataclass(frozen=True, slots=True)
class CachedClips:
    """The clips of a source, each of which is made once and kept in a folder.

    Several processes may share the folder: two that make the same clip at once write the same file.

    Attributes:
        source: of the clips, whose `repr` says all that decides them, as that of `SimulatedClips` does.
        folder: made unless it exists.

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
        made = self.source.clip(index)
        save_clip(path, made)
        return made
