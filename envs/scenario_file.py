"""Scenarios that users write: a YAML file with a scenario to start from, its numbers, and options.

| key | value |
|---|---|
| `scenario` | name of a registered scenario |
| `place` | a place of one's own instead, see `coopsim.world.own.place` |
| `density` | a factor on the numbers of vehicles and people |
| `population` | fields of `coopsim.world.scenario.Population` |
| `options` | fields of `CommonOptions` and `SimulationOptions`; `weather` has those of `Weather`, |
| | and `lidar` is a name, a path, or has those of `LidarConfig` |
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import yaml

from coopsim.envs.options import CommonOptions, SimulationOptions
from coopsim.errors import CoopsimError, ScenarioFileError, UnknownNameError
from coopsim.located_yaml import Entry
from coopsim.sensors.air import Weather
from coopsim.sensors.lidar import LidarConfig
from coopsim.world.own.place import read_place
from coopsim.world.scenario import SCENARIOS, Place, Population

SHIPPED = Path(__file__).parent / "scenarios"
"""Where the files lie that come along; they are found by their names, too."""

_NOT_IN_FILES = {"detector", "render_mode"}


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """What a file says.

    Attributes:
        path: of the file.
        scenario: the one to start from: its name, or a place that the file describes.
        keywords: as `coopsim.parallel_env` takes them.
        lines: where each key stands, from 1.
    """

    path: Path
    scenario: str | Place
    keywords: Mapping[str, Any]
    lines: Mapping[str, int]

    def blame(self, error: CoopsimError, beside: Collection[str] = ()) -> CoopsimError:
        """The same error with the file and the line of the key that it names, if that is not one of `beside`.

        An error that names no key of the file may be the fault of those beside, if there are any.
        """
        for key in sorted(set(self.lines) - set(beside), key=len, reverse=True):
            if re.match(rf"(unknown )?{key}\b", str(error)):
                return _error(self.path, self.lines[key], str(error))
        return error if beside else ScenarioFileError(f"{self.path}: {error}")


def find_scenario_file(path: str | Path) -> Path:
    """The file at `path`, or the one of that name that comes along.

    Raises:
        ScenarioFileError: there is neither.
    """
    wanted = Path(path)
    for place in (wanted, SHIPPED / wanted):
        if place.is_file():
            return place
    known = ", ".join(sorted(file.name for file in SHIPPED.glob("*.yaml")))
    raise ScenarioFileError(f"there is no scenario file {str(path)!r}. Accepted: a path, or one of {known}")


def load_scenario_file(path: str | Path) -> ScenarioFile:
    """Read a file, and check its keys; values are checked when an environment is made.

    Raises:
        ScenarioFileError: names the file and, where known, the line.
    """
    file = find_scenario_file(path)
    try:
        text = file.read_text(encoding="utf-8")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        content = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise _error(file, line, f"this is no YAML: {error.problem}") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ScenarioFileError(f"{file}: cannot be read: {error}") from error
    lines: dict[str, int] = {}
    sections: dict[str, Any] = dict.fromkeys(("scenario", "place", "density"))
    _check_keys(file, node, sections | {"population": _names(Population), "options": _options()}, lines)
    scenario = _scenario(file, node, lines)
    keywords = {**(content.get("population") or {}), **(content.get("options") or {})}
    if "density" in content:
        keywords["density"] = content["density"]
    loaded = ScenarioFile(file, scenario, keywords, lines)
    for key, kind in (("weather", Weather), ("lidar", LidarConfig)):
        if isinstance(keywords.get(key), dict):
            try:
                keywords[key] = kind(**keywords[key])
            except CoopsimError as error:
                raise loaded.blame(error) from error
    return loaded


def _scenario(file: Path, node: yaml.Node, lines: Mapping[str, int]) -> str | Place:
    """The one that the file names, or describes."""
    top = Entry(file, node, "scenario file", 1).named()
    if "place" in top and "scenario" in top:
        raise top["place"].error("place takes the place of scenario: one of them is accepted")
    if "place" in top:
        return read_place(top["place"])
    if "scenario" not in top:
        raise _error(
            file, 1, f"scenario is missing. Accepted: {', '.join(SCENARIOS)}; or place, with roads of your own"
        )
    return top["scenario"].choice(SCENARIOS)


def _names(kind: type[Any]) -> dict[str, None]:
    return {field.name: None for field in fields(kind)}


def _options() -> dict[str, dict[str, None] | None]:
    """Names of options, and the fields of those that have any; a LiDAR may be a name instead."""
    known = _names(CommonOptions) | _names(SimulationOptions)
    nested = {"weather": _names(Weather), "lidar": _names(LidarConfig)}
    return {name: nested.get(name) for name in known if name not in _NOT_IN_FILES}


def _check_keys(file: Path, node: yaml.Node | None, known: Mapping[str, Any], lines: dict[str, int]) -> None:
    """Every key must be known and come once; notes their lines."""
    if not isinstance(node, yaml.MappingNode):
        line = 1 if node is None else node.start_mark.line + 1
        raise _error(file, line, f"expected keys and values. Accepted: {', '.join(sorted(known))}")
    here: set[str] = set()
    for key, value in node.value:
        line, name = key.start_mark.line + 1, str(key.value)
        if name not in known:
            raise _error(file, line, str(UnknownNameError("key", name, known)))
        if name in here:
            raise _error(file, line, f"{name} is there twice")
        here.add(name)
        lines[name] = line
        may_be_name = name == "lidar" and isinstance(value, yaml.ScalarNode)
        if known[name] is not None and not may_be_name:
            _check_keys(file, value, known[name], lines)


def _error(file: Path, line: int, message: str) -> ScenarioFileError:
    return ScenarioFileError(f"{file}:{line}: {message}")
