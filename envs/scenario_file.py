"""Scenarios that users write: a YAML file with a scenario to start from, its numbers, and options.

| key | value |
|---|---|
| `scenario` | name of a registered scenario |
| `place` | a place of one's own instead, see `coopsim.world.custom.place` |
| `density` | a factor on the numbers of vehicles and people |
| `seed` | of the episodes, unless whoever begins one gives another |
| `population` | fields of `coopsim.world.population.Population` |
| `options` | fields of `CommonOptions` and `SimulationOptions`; `weather` has those of `Weather`, |
| | and `lidar` is a name, a path, or has those of `LidarConfig`, or names with any of these; |
| | `detector` is a name |

Paths in it are relative to the file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import EllipsisType
from typing import Any

from yaml import MappingNode

from coopsim.config.keyed_yaml import KeyedYaml, Known, read_keyed_yaml
from coopsim.config.mappings import with_paths_from
from coopsim.envs.lidar_options import LIDAR_FIELDS
from coopsim.envs.options import CommonOptions
from coopsim.envs.simulation_options import SimulationOptions
from coopsim.errors import CoopsimError, ScenarioFileError
from coopsim.sensors.weather import Weather
from coopsim.world.custom.place import read_place
from coopsim.world.population import Population
from coopsim.world.scenario import SCENARIOS, Place

SHIPPED = Path(__file__).parent / "scenarios"
"""Where the files lie that come along; they are found by their names, too."""

_NOT_AMONG_OPTIONS = {"render_mode", "seed"}


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """What a file says.

    Attributes:
        file: where it says so.
        scenario: the one to start from: its name, or a place that the file describes.
        keywords: as `coopsim.parallel_env` takes them.
    """

    file: KeyedYaml
    scenario: str | Place
    keywords: Mapping[str, Any]

    def blame(self, error: CoopsimError, beside: Collection[str] = ()) -> CoopsimError:
        """The same error with the file and the line of the key that it names, if that is not one of `beside`.

        An error that names no key of the file may be the fault of those beside, if there are any.
        """
        blamed = self.file.blame(error, beside)
        return blamed or (error if beside else ScenarioFileError(f"{self.file.path}: {error}"))


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
    sections: dict[str, Any] = dict.fromkeys(("scenario", "place", "density", "seed"))
    known = sections | {"population": _names(Population), "options": _options()}
    file = read_keyed_yaml(find_scenario_file(path), known, ScenarioFileError, may_be_value=("lidar",))
    content = file.content
    _check_lidars(file)
    keywords = {**(content.get("population") or {}), **(content.get("options") or {})}
    keywords = with_paths_from(file.path.parent, keywords)
    keywords |= {name: content[name] for name in ("density", "seed") if name in content}
    loaded = ScenarioFile(file, _scenario(file), keywords)
    if isinstance(keywords.get("weather"), dict):
        try:
            keywords["weather"] = Weather(**keywords["weather"])
        except CoopsimError as error:
            section = "options", "weather"
            raise file.blame(error, within=section) or file.wrong(str(error), *section) from error
    return loaded


def _check_lidars(file: KeyedYaml) -> None:
    """Keys of a LiDAR, or of each that has a name and keys; a misspelt one must not become a name."""
    options = file.root.named().get("options")
    lidar = options.named().get("lidar") if options is not None else None
    if lidar is None or not isinstance(lidar.node, MappingNode):
        return
    inner = [each for each in lidar.named().values() if isinstance(each.node, MappingNode)]
    for section in inner or [lidar]:
        section.fields([], LIDAR_FIELDS)


def _scenario(file: KeyedYaml) -> str | Place:
    """The one that the file names, or describes."""
    top = file.root.named()
    if "place" in top and "scenario" in top:
        raise top["place"].error("place takes the place of scenario: one of them is accepted")
    if "place" in top:
        return read_place(top["place"])
    if "scenario" not in top:
        raise file.wrong(f"scenario is missing. Accepted: {', '.join(SCENARIOS)}; or place, with roads of your own")
    return top["scenario"].choice(SCENARIOS)


def _names(kind: type[Any]) -> dict[str, None]:
    return {field.name: None for field in fields(kind)}


def _options() -> dict[str, Known | EllipsisType | None]:
    """Names of options, and the fields of those that have any; for those of LiDARs see `_check_lidars`."""
    known = _names(CommonOptions) | _names(SimulationOptions)
    nested: dict[str, Known | EllipsisType] = {"weather": _names(Weather), "lidar": ...}
    return {name: nested.get(name) for name in known if name not in _NOT_AMONG_OPTIONS}
