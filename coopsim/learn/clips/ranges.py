"""Ranges and lists of recipes: their checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_between, require_count


def as_list(name: str, given: object) -> tuple[Any, ...]:
    """Return one or more values as a tuple."""
    if isinstance(given, (str, bytes)) or not isinstance(given, Sequence) or not given:
        raise InvalidValueError(f"{name} must be a list of values, got {given!r}")
    return tuple(given)


def as_range(name: str, given: object, least: float, most: float) -> tuple[float, float]:
    """Return the ends of a range in [least, most]."""
    first, last = _ends(name, given, lambda end: require_between(least, most, **{name: end}))
    return float(first), float(last)


def as_count_range(name: str, given: object) -> tuple[int, int]:
    """Return the ends of a range of counts."""
    first, last = _ends(name, given, lambda end: require_count(0, **{name: end}))
    return int(first), int(last)


def _ends(name: str, given: object, require: Callable[[Any], object]) -> tuple[Any, Any]:
    ends = as_list(name, given)
    for end in ends:
        require(end)
    if len(ends) != 2 or ends[0] > ends[1]:
        raise InvalidValueError(f"{name} must be a pair of numbers, the smaller first, got {list(ends)}")
    return ends[0], ends[1]
