"""Reading of JSON files in checks: what is wrong is said, with the file and the field, rather than raised."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.export.problem import Problem

Test = Callable[[Any], bool]
Fields = Mapping[str, tuple[Test, str]]
"""Fields by name, with dots between a field and its part: a test, and what is accepted."""

_ORTHONORMAL = 1e-5


def read_json(path: Path) -> tuple[Any, str]:
    """Return the content of a file and "", or None and the reason why there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8")), ""
    except (OSError, ValueError) as error:
        return None, f"cannot be read: {' '.join(str(getattr(error, 'strerror', None) or error).split())}"


def read_list(path: Path, file: str) -> tuple[list[Any], list[Problem]]:
    """Return the list that a file holds, and problems instead if it holds none.

    Args:
        path: of the file.
        file: its name in problems.
    """
    content, reason = read_json(path)
    if not reason and not isinstance(content, list):
        reason = f"must be a list, got {type(content).__name__}"
    return ([], [Problem(file, "", reason)]) if reason else (content, [])


def check_fields(record: Any, fields: Fields, file: str, where: str) -> Iterator[Problem]:
    """Yield the fields of a record that are missing or wrong; `where` goes before their names."""
    for name, (accepts, accepted) in fields.items():
        value: Any = record
        for part in name.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        if not accepts(value):
            yield Problem(file, f"{where}.{name}".lstrip("."), f"must be {accepted}, got {_short(value)}")


def is_text(value: Any) -> bool:
    """Accept a text that is not empty."""
    return isinstance(value, str) and bool(value)


def is_number(value: Any) -> bool:
    """Accept a finite number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def is_positive(value: Any) -> bool:
    """Accept a finite number above 0."""
    return is_number(value) and value > 0


def is_count(value: Any) -> bool:
    """Accept an integer from 0 on."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def numbers(count: int) -> Test:
    """Accept a list of that many finite numbers."""
    return lambda value: isinstance(value, list) and len(value) == count and all(map(is_number, value))


def sizes(count: int) -> Test:
    """Accept a list of that many numbers above 0."""
    return lambda value: isinstance(value, list) and len(value) == count and all(map(is_positive, value))


def is_rotation(value: Any) -> bool:
    """Accept three rows of a rotation matrix."""
    if not (isinstance(value, list) and len(value) == 3 and all(map(numbers(3), value))):
        return False
    turn = np.array(value, np.float64)
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() < _ORTHONORMAL and np.linalg.det(turn) > 0)


def is_column(value: Any) -> bool:
    """Accept a column of three numbers."""
    return isinstance(value, list) and len(value) == 3 and all(map(numbers(1), value))


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
