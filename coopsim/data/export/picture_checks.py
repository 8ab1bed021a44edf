"""Checks of the pictures in an exported folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from coopsim.data.export.problem import Problem
from coopsim.data.files.pictures import opened_picture
from coopsim.errors import RecordingError


def check_picture(path: Path, file: str) -> Iterator[Problem]:
    """Yield what is wrong with a picture.

    Args:
        path: of the file.
        file: its name in problems.
    """
    try:
        with opened_picture(path) as picture:
            picture.load()
    except RecordingError as error:
        yield Problem(file, "", str(error).removeprefix(f"{path}: this "))
