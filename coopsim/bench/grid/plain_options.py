"""Options as plain data, which mean the same in every process and stand in files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coopsim.errors import InvalidValueError

_MOST_ITEMS = 1_000_000
"""Most items of a list among options, which are all written into every cell's file."""


def plain_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as JSON has them, so that they mean the same in every process.

    Raises:
        InvalidValueError: an option is an object, such as a detector, or has too many items; the message names it.
    """
    return {name: _plain(name, value) for name, value in options.items()}


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(f"{name}.{key}", part) for key, part in value.items()}
    if name == "place_seed" and isinstance(value, range) and value and value.step == 1 and value.start >= 0:
        return f"{value.start}-{value[-1]}"  # as in files and on the command line: it may have a billion numbers
    if isinstance(value, (list, tuple, range)):
        if len(value) > _MOST_ITEMS:
            raise InvalidValueError(
                f"{name} must have at most {_MOST_ITEMS} items, got {len(value)}: for a range of places use "
                "a text like '0-999999999'"
            )
        return [_plain(name, part) for part in value]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InvalidValueError(
        f"{name} must be plain data (a number, a text, True, False, None, a list or a mapping of these), got {value!r}"
    )
