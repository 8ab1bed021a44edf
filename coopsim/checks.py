"""Checks of what users give, each with one message: what was wrong, and what is accepted."""

from __future__ import annotations

import numbers
from collections.abc import Iterable

import numpy as np

from coopsim.errors import InvalidValueError, UnknownNameError


def require_positive(**values: float) -> None:
    """Each must be a finite number > 0."""
    for name, value in values.items():
        if not (_is_number(value) and np.isfinite(value) and value > 0):
            raise InvalidValueError(f"{name} must be a finite number > 0, got {value!r}")


def require_non_negative(**values: float) -> None:
    """Each must be a finite number >= 0."""
    for name, value in values.items():
        if not (_is_number(value) and np.isfinite(value) and value >= 0):
            raise InvalidValueError(f"{name} must be a finite number >= 0, got {value!r}")


def require_probability(**values: float) -> None:
    """Each must be in [0, 1]."""
    for name, value in values.items():
        if not (_is_number(value) and 0 <= value <= 1):
            raise InvalidValueError(f"{name} must be in [0, 1], got {value!r}")


def require_threshold(**values: float) -> None:
    """Each must be in (0, 1]: an overlap from which two boxes are one object."""
    for name, value in values.items():
        if not (_is_number(value) and 0 < value <= 1):
            raise InvalidValueError(f"{name} must be in (0, 1], got {value!r}")


def require_count(least: int, **values: object) -> None:
    """Each must be an integer >= `least`."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
            raise InvalidValueError(f"{name} must be an integer >= {least}, got {value!r}")


def require_choice(name: str, value: object, accepted: Iterable[str]) -> None:
    """It must be one of the accepted names."""
    if value not in (known := tuple(accepted)):
        raise UnknownNameError(name, value, known)


def _is_number(value: object) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)
