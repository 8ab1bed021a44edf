"""Grids from YAML files: those that come along as presets, and users' own.

A file has the attributes of `Grid` as its keys; `options` has those of an environment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from coopsim.bench.grid.grid import Grid
from coopsim.config.yaml_file import Section, read_yaml
from coopsim.errors import CoopsimError, GridFileError, InvalidValueError
from coopsim.support.checks import require_choice

_PRESETS = Path(__file__).parent / "presets"

PRESETS = tuple(sorted(path.stem for path in _PRESETS.glob("*.yaml")))
"""Names of the grids that come along."""

_ABOUT = {
    "policies": r"(unknown )?(parameter of )?policy\b",
    "scenarios": r"unknown environment\b|there is no scenario",
}
"""How errors begin that are about one of a key's values."""


@dataclass(frozen=True, slots=True)
class GridSource:
    """Where a grid comes from: a file, if there is one, and what was given beside it.

    Attributes:
        file: None: all is given.
        beside: attributes of `Grid` that go before the file's; `options` are merged, by name.
    """

    file: Section | None
    beside: Mapping[str, Any]

    def grid(self) -> Grid:
        """The grid.

        Raises:
            GridFileError: a value in the file is not accepted; names the line.
            InvalidValueError: a value given beside it is not.
        """
        content = {} if self.file is None else dict(self.file)
        given = {**content, **self.beside}
        if content.get("options") is not None and "options" in self.beside:
            given["options"] = {**content["options"], **self.beside["options"]}
        if not given.get("policies"):
            presets = ", ".join(PRESETS)
            raise InvalidValueError(f"policies must be at least one; name them, or take a preset ({presets}) or a file")
        try:
            return Grid(**given)
        except CoopsimError as error:
            raise self.blame(error) from error

    def blame(self, error: CoopsimError) -> CoopsimError:
        """The error, with file and line where it is the file's fault."""
        beside = {*self.beside, *self.beside.get("options", ())}
        if self.file is None or error.place is not None:
            return error
        about = [key for key, begins in _ABOUT.items() if key not in beside and re.match(begins, str(error))]
        place = self.file.place(about[0]) if about and about[0] in self.file else self.file.blame(error, beside)
        return error if place is None else GridFileError(str(error)).at(place)


def find_grid(
    preset: str | None = None, path: str | Path | None = None, *, more_policies: Sequence[str] = (), **beside: Any
) -> GridSource:
    """A grid by the name of a preset or by the path of a file, or from nothing but what is given beside.

    Args:
        preset: one of `PRESETS`.
        path: of a file.
        more_policies: next to those that the file names, or those that are given beside.
        **beside: attributes of `Grid`.

    Raises:
        UnknownNameError: there is no such preset.
        InvalidValueError: a preset and a file are one too many.
        GridFileError: the file is missing or has a key that it should not; names the line.
    """
    if preset is not None and path is not None:
        raise InvalidValueError(f"a preset and a file are one grid too many, got {preset!r} and {str(path)!r}")
    if preset is not None:
        require_choice("preset", preset, PRESETS)
        path = _PRESETS / f"{preset}.yaml"
    file = None if path is None else _read(Path(path))
    if more_policies:
        named = beside.get("policies") or (file.get("policies") if file is not None else None) or ()
        if isinstance(named, (list, tuple)):  # of anything else `Grid` says that it must be a list
            beside["policies"] = (*named, *more_policies)
    return GridSource(file, beside)


def _read(path: Path) -> Section:
    root = read_yaml(path, GridFileError)
    root.fields((), [field.name for field in fields(Grid)])
    content: Section = root.value
    return content
