"""Checks of values by name: `require_positive(dt_s=dt_s)`. Errors say what is accepted and what was given."""

from __future__ import annotations

import itertools
import math
import numbers
from collections.abc import Callable, Iterable, Mapping, Set
from typing import Any

import numpy as np

from coopsim.errors import InvalidValueError, UnknownNameError

MOST_RUNS = 100_000
"""Largest number of cells of a benchmark, and of episodes of a measurement or an export: more would be prepared for
minutes, in gigabytes of memory, before the first one runs."""


def require_number(accepted: str, accepts: Callable[[float], bool], **values: object) -> None:
    """Require real numbers that `accepts` takes, False for NaN; None, a flag or a text is no number."""
    for name, value in values.items():
        if not accepts(_as_float(value)):
            raise InvalidValueError(f"{name} must be {accepted}, got {value!r}")


def require_finite_number(**values: object) -> None:
    """Require finite numbers."""
    require_number("a finite number", math.isfinite, **values)


def require_positive(**values: object) -> None:
    """Require finite numbers > 0."""
    require_number("a finite number > 0", lambda value: 0 < value < math.inf, **values)


def require_non_negative(**values: object) -> None:
    """Require finite numbers >= 0."""
    require_number("a finite number >= 0", lambda value: 0 <= value < math.inf, **values)


def require_between(least: float, most: float, /, **values: object) -> None:
    """Require numbers in [least, most]."""
    require_number(f"in [{least:g}, {most:g}]", lambda value: least <= value <= most, **values)


def require_probability(**values: object) -> None:
    """Require numbers in [0, 1]."""
    require_between(0, 1, **values)


def require_threshold(**values: object) -> None:
    """Require numbers in (0, 1]: overlaps from which two boxes are one object."""
    require_number("in (0, 1]", lambda value: 0 < value <= 1, **values)


def require_frame_time(dt_s: object) -> None:
    """Require a time between two frames in [1e-6, 3600] s: integer nanoseconds resolve it, and hold sums of it."""
    require_positive(dt_s=dt_s)
    require_between(1e-6, 3600, dt_s=dt_s)


def require_count(least: int, most: int | None = None, **values: object) -> None:
    """Require integers >= `least` and, if it is given, <= `most`."""
    accepted = f">= {least}" if most is None else f"in {least}..{most}"
    for name, value in values.items():
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, np.integer))
            or value < least
            or (most is not None and value > most)
        ):
            raise InvalidValueError(f"{name} must be an integer {accepted}, got {value!r}")


def require_flag(**values: object) -> None:
    """Require True or False, not only values that Python takes for one of them."""
    for name, value in values.items():
        if not isinstance(value, (bool, np.bool_)):
            raise InvalidValueError(f"{name} must be True or False, got {value!r}")


def require_choice(name: str, value: object, accepted: Iterable[str], where: str = "") -> None:
    """Require one of the accepted names; raise `UnknownNameError` otherwise, with `name` as the kind."""
    known = tuple(accepted)
    if not (isinstance(value, str) and value in known):
        raise UnknownNameError(name, value, known, where)


def as_runs(**values: object) -> tuple[Any, ...]:
    """Return the elements of an iterable that is given by name; raise unless they are ordered, and 1 to `MOST_RUNS`."""
    ((name, given),) = values.items()
    unordered = isinstance(given, (str, bytes, Mapping, Set))
    taken = tuple(itertools.islice(given, MOST_RUNS + 1)) if isinstance(given, Iterable) and not unordered else ()
    if not taken:
        raise InvalidValueError(f"{name} must be a list of at least one, in brackets in YAML, got {given!r}")
    if len(taken) > MOST_RUNS:
        raise InvalidValueError(f"{name} must be a list of at most {MOST_RUNS:,}, got more")
    return taken


def require_instance(wanted: type[Any], **values: object) -> None:
    """Require objects of the class `wanted`, or None."""
    for name, value in values.items():
        if value is not None and not isinstance(value, wanted):
            hint = f": write {value.__name__}()" if isinstance(value, type) and issubclass(value, wanted) else ""
            raise InvalidValueError(f"{name} must be a coopsim {wanted.__name__} or None, got {value!r}{hint}")


def _as_float(value: object) -> float:
    """Return a number as a float; NaN, which is in no range, for all else and for integers too large for a float."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan
