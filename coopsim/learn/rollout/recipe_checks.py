"""Checks of the values of a `WorldRecipe`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.catalog import is_recordings_folder, is_scenario_file, scenario_files
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.support.checks import require_between, require_choice, require_count, require_positive
from coopsim.world.scenario import SCENARIOS
from coopsim.world.towns.town_scenarios import TOWN

_TEST_LIDARS = ("VLP-16", "OS1-128")


def require_training_place(name: object, *, allowed: bool) -> None:
    """Refuse what is no towns, scenario file or folder of recordings, and test places unless they are `allowed`.

    A file that is not shipped may still start from a test place, which is seen when it is read.
    """
    if not isinstance(name, str):
        raise InvalidValueError(f"environments must be names, or paths of scenario files or recordings, got {name!r}")
    if is_recordings_folder(name):
        return
    is_file = is_scenario_file(name)
    if not is_file:
        require_choice("environment", name, (TOWN, *SCENARIOS))
    is_own = is_file and Path(name).name not in scenario_files()
    if not (name == TOWN or is_own or allowed):
        raise InvalidValueError(
            f"environments must not be {name!r}, which is a test place: results are measured on the named scenarios "
            f"and the shipped files, so nothing is trained on them. Accepted: {TOWN!r}, scenario files of your own, or "
            "this one with allow_test_places: true"
        )


def as_lidar_weights(lidars: object, *, allowed: bool) -> dict[str, float]:
    """Return the weights of beam tables; test sensors are refused unless they are `allowed`."""
    weights = as_weights("lidars", "beam tables", lidars, PATTERNS)
    for name in weights:
        if name in _TEST_LIDARS and not allowed:
            raise InvalidValueError(
                f"lidars must not have {name!r}, which is a test sensor: results are measured on it untrained; it is "
                "accepted with allow_test_places: true"
            )
    return weights


def as_weights(option: str, what: str, given: object, known: Iterable[str], least: int = 1) -> dict[str, float]:
    """Return the weights of names.

    Args:
        option: its name.
        what: the kind of the names, in the plural, for errors.
        given: the names with their weights.
        known: names that are accepted.
        least: number of names.
    """
    if not isinstance(given, Mapping) or len(given) < least:
        raise InvalidValueError(f"{option} must be a mapping of {what} to weights, got {given!r}")
    for name, weight in given.items():
        require_choice(option, name, known)
        require_positive(**{f"the weight of {name}": weight})
    return {name: float(weight) for name, weight in given.items()}


def as_list(name: str, given: object) -> tuple[Any, ...]:
    """Return one or more values as a tuple."""
    if isinstance(given, (str, bytes)) or not isinstance(given, Sequence) or not given:
        raise InvalidValueError(f"{name} must be a list of values, got {given!r}")
    return tuple(given)


def as_range(name: str, given: object, least: float, most: float) -> tuple[float, float]:
    """Return the ends of a range in [least, most]."""
    ends = as_list(name, given)
    for end in ends:
        require_between(least, most, **{name: end})
    first, last = _pair(name, ends)
    return float(first), float(last)


def as_count_range(name: str, given: object) -> tuple[int, int]:
    """Return the ends of a range of counts."""
    ends = as_list(name, given)
    for end in ends:
        require_count(0, **{name: end})
    first, last = _pair(name, ends)
    return int(first), int(last)


def _pair(name: str, ends: tuple[Any, ...]) -> tuple[Any, Any]:
    if len(ends) != 2 or ends[0] > ends[1]:
        raise InvalidValueError(f"{name} must be a pair of numbers, the smaller first, got {list(ends)}")
    return ends[0], ends[1]
