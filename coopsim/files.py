"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from coopsim.errors import InvalidValueError


def write_whole(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file; whatever interrupts it, the old file stays and nothing else is left.

    Raises:
        InvalidValueError: the file cannot be written.
    """
    target = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(dir=target.absolute().parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(temporary, 0o644)
            os.replace(temporary, target)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise InvalidValueError(f"cannot write {target}: {error.strerror}") from error
    return target
