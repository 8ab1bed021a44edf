"""Grids from YAML files: shipped presets and users' own.

A file has the attributes of `Grid` as its keys, or `environments` for `scenarios`; `options` has those of an
environment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coopsim.bench.grid.grid import ATTRIBUTES, Grid
from coopsim.config.yaml_file import Section, read_yaml
from coopsim.errors import CoopsimError, GridFileError, InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.user_code import code_in

_PRESETS = Path(__file__).parent / "presets"

PRESETS = tuple(sorted(path.stem for path in _PRESETS.glob("*.yaml")))
"""Names of the shipped grids."""

_WORLDS = "environments"
"""Key of the command line's name for `Grid.scenarios`."""

_MERGED = ("options", "axes")
"""Keys whose values are merged by name with those that are given beside a file."""

_ABOUT = {
    "policies": r"(unknown )?(parameter of )?policy\b",
    "scenarios": r"unknown environment\b|there is no scenario",
}
"""Beginnings of errors about one of a key's values."""


@dataclass(frozen=True, slots=True)
class GridSource:
    """The origin of a grid: a file, if there is one, and attributes that override the file's; `options` and
    `axes` are merged by name.
    """

    file: Section
    overrides: Mapping[str, Any]

    def grid(self) -> Grid:
        """Make the grid.

        Raises:
            GridFileError: a value in the file is not accepted; names the line.
            InvalidValueError: an overriding value is not accepted.
        """
        given = {**self.file, **self.overrides}
        for name in _MERGED:
            if self.file.get(name) is not None and name in self.overrides:
                given[name] = {**self.file[name], **self.overrides[name]}
        if not given.get("policies"):
            presets = ", ".join(PRESETS)
            raise InvalidValueError(f"policies must be at least one; name them, or take a preset ({presets}) or a file")
        try:
            return Grid(**given)
        except CoopsimError as error:
            raise self.blame(error) from error

    def blame(self, error: CoopsimError) -> CoopsimError:
        """Return the error, with file and line if a value of the file caused it."""
        overridden = {*self.overrides, *(name for merged in _MERGED for name in self.overrides.get(merged, ()))}
        keys = [key for key in _ABOUT if key in self.file and key not in overridden]
        about = next((key for key in keys if re.match(_ABOUT[key], str(error))), None)
        place = self.file.blame(error, overridden) if about is None else self.file.place(about)
        return error if place is None or error.place is not None else GridFileError(str(error)).at(place)


def find_grid(
    preset: str | None = None,
    path: str | Path | None = None,
    *,
    more_policies: Sequence[str] = (),
    trust: bool = False,
    **overrides: Any,
) -> GridSource:
    """Find a grid by the name of a preset or the path of a file; without both, `overrides` are all of it.

    `more_policies` are added to those of the file or of `overrides`; `trust` lets a file name code to run
    (`module:Class` or `file.py:Class`).

    Raises:
        UnknownNameError: there is no such preset.
        InvalidValueError: both a preset and a file are given.
        GridFileError: the file is missing, has an unknown key, or names code without `trust`; names the line.
    """
    if preset is not None and path is not None:
        raise InvalidValueError(f"a preset and a file are one grid too many, got {preset!r} and {str(path)!r}")
    if preset is not None:
        require_choice("preset", preset, PRESETS)
        path = _PRESETS / f"{preset}.yaml"
    file = Section()
    if path is not None:
        root = read_yaml(Path(path), GridFileError)
        root.fields((), (*ATTRIBUTES, _WORLDS))
        file = root.value
        if _WORLDS in file:
            if "scenarios" in file:
                raise GridFileError(f"{_WORLDS} and scenarios are one list too many").at(file.place(_WORLDS))
            file.rename(_WORLDS, "scenarios")
        if not trust:
            _refuse_code(file, overrides)
    if more_policies:
        named = overrides.get("policies") or file.get("policies") or ()
        if isinstance(named, (list, tuple)):  # `Grid` refuses anything else
            overrides["policies"] = (*named, *more_policies)
    return GridSource(file, overrides)


def _refuse_code(file: Section, overrides: Mapping[str, Any]) -> None:
    """Refuse code that a file names, such as policies, planners and attacks, where nothing takes its place."""
    for key, value in file.items():
        if key in _MERGED and isinstance(value, Mapping):
            value = {name: each for name, each in value.items() if name not in overrides.get(key, {})}
        elif overrides.get(key):
            continue
        if (code := code_in(value)) is not None:
            flag = "--policies" if key == "policies" else "the command"
            problem = f"{key} name code to run, {code!r}: give it by {flag}, or add --trust if you trust the file"
            raise GridFileError(problem).at(file.place(key))
