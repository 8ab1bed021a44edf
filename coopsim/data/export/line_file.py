"""Text files that grow line by line and appear whole."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from coopsim.errors import InvalidValueError
from coopsim.support.files import note_written


class LineFile:
    """A text file of which lines are appended; it gets its name when it is closed.

    Until then it is called `<name>.tmp`. What an interrupted writer left under that name is overwritten.

    Args:
        path: the file, in an existing folder.

    Raises:
        InvalidValueError: the file cannot be written, also by `append` and `close`.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._part = path, path.with_name(f"{path.name}.tmp")
        self._write("w", ())

    def append(self, *lines: str) -> None:
        """Append lines; ends of lines are added."""
        self._write("a", lines)

    def close(self) -> None:
        """End the file and give it its name."""
        try:
            os.replace(self._part, self._path)
            note_written(self._path)
        except OSError as error:
            raise self._failed(error) from error

    def discard(self) -> None:
        """Remove what was written; for writers that do not go on later."""
        self._part.unlink(missing_ok=True)

    def _write(self, mode: str, lines: Iterable[str]) -> None:
        try:
            # Opened for each call: an export that is given up leaves no open files.
            with self._part.open(mode, encoding="utf-8", newline="\n") as file:
                file.writelines(f"{line}\n" for line in lines)
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> InvalidValueError:
        return InvalidValueError(f"cannot write {self._path}: {error.strerror or error}")
