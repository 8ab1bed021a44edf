"""Formats of folders with recordings, by name and by a look."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.recordings.recorded_folder import ReadingOptions, RecordedFolder
from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry

TEXT = "text"
"""The format without sweeps: `coopsim.data.recording_set`."""

AUTO = "auto"

RECORDINGS: Registry[type[RecordedFolder]] = Registry(
    "format of recordings", home="coopsim.data.shipped_recordings", group="coopsim.recordings"
)
"""Formats with sweeps. Installed packages add theirs through the entry-point group `coopsim.recordings`."""

_TEXT_LAYOUT, _TEXT_ASKED = "labels/<sequence>.txt with detections/<name>/ (text)", 45


def formats() -> tuple[str, ...]:
    """Return the accepted names of formats."""
    return (AUTO, TEXT, *RECORDINGS)


def find_format(path: str | Path) -> str:
    """Return the name of a folder's format, found by the names in it and, for OPV2V's layout, by a look at one frame.

    Raises:
        InvalidValueError: `path` is no path.
        RecordingError: there is no such folder, or it has no known format; says what was looked for.
    """
    if not isinstance(path, (str, Path)):
        raise InvalidValueError(f"path must be the folder of a recording set, got {path!r}; one has {_any_layout()}")
    folder = Path(path)
    try:
        return _find(folder)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def open_folder(path: str | Path, options: ReadingOptions | None = None, name: str = AUTO) -> RecordedFolder:
    """Return a folder with sweeps, as its format reads it; no frame is read but one to tell formats apart.

    Args:
        path: the folder.
        options: choices that its files leave open.
        name: name of the format; "auto" finds it.

    Raises:
        UnknownNameError: there is no such format.
        RecordingError: the folder is none of this format, or has no sequence.
    """
    require_choice("format", name, (AUTO, *RECORDINGS))
    found = find_format(path) if name == AUTO else name
    if found == TEXT:
        raise RecordingError(f"{path} has detections in text files, and no sweeps; needed: {'; or '.join(_layouts())}")
    try:
        folder = RECORDINGS.get(found)(Path(path), options or ReadingOptions())
        sequences = folder.sequences
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if not sequences:
        raise RecordingError(f"{path} has no recordings of format {found!r}; looked for: {_any_layout()}")
    return folder


def _find(path: Path) -> str:
    if not path.is_dir():
        raise RecordingError(f"no folder {path}: a recording set has {_any_layout()}")
    installed = [name for name in RECORDINGS if RECORDINGS.is_installed(name)]
    looks: list[tuple[int, str, Callable[[Path], bool]]] = [(_TEXT_ASKED, TEXT, _is_text)]
    looks += [
        (each.asked, name, each.found_in)
        for name in RECORDINGS
        if name not in installed
        for each in (RECORDINGS.get(name),)
    ]
    for _, name, found_in in sorted(looks, key=lambda look: look[:2]):
        if found_in(path):
            return name
    for name in installed:  # last, so that one that is broken costs its own recordings alone
        if RECORDINGS.get(name).found_in(path):
            return name
    raise RecordingError(f"{path} has no recordings; looked for: {_any_layout()}")


def _is_text(path: Path) -> bool:
    return (path / "labels").is_dir() or (path / "detections").is_dir()


def _layouts() -> list[str]:
    layouts = (RECORDINGS.get(name).layout for name in RECORDINGS if not RECORDINGS.is_installed(name))
    return [layout for layout in dict.fromkeys(layouts) if layout]


def _any_layout() -> str:
    return "; or ".join((_TEXT_LAYOUT, *_layouts()))
