"""Scenarios that users write: a YAML file with a scenario to start from, its numbers, and options.

| key | value |
|---|---|
| `scenario` | name of a registered scenario |
| `place` | a custom place instead, see `coopsim.world.custom.place` |
| `situation` | a situation in that scenario or place, see `coopsim.world.situations.written` |
| `density` | a factor on the numbers of vehicles and people |
| `seed` | seed of the episodes for which `reset` is given none |
| `population` | fields of `coopsim.world.population.Population` |
| `options` | fields of `CommonOptions` and `SimulationOptions`; objects are mappings of their fields; for |
| | the scenario `town` also those of `PlaceSeeds` and `TownOptions` |

Paths in it are relative to the file. No key names a path to write or code to run.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from coopsim.catalog import WRITING_OPTIONS
from coopsim.config.checked_entry import Entry
from coopsim.config.yaml_file import FileEntry, Section, read_yaml
from coopsim.envs.options import CommonOptions
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import CoopsimError, ScenarioFileError
from coopsim.support.checks import require_choice
from coopsim.support.user_code import code_in
from coopsim.world.custom.place import read_place, write_place_file
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.drawn_places import TOWN, scenario_names
from coopsim.world.places.description import PlaceDescription
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import SCENARIOS, Place
from coopsim.world.situations.situation import NAMED, SITUATIONS, Situation
from coopsim.world.situations.written import ROLE_KEYS, WrittenSituation, read_roles

SHIPPED = Path(__file__).parent / "scenarios"
"""Folder of the shipped files, which are found by their names, too."""

_TOP = ("scenario", "place", "situation", "density", "seed")
_SECTIONS = {
    "population": [field.name for field in fields(Population)],
    "options": [
        field.name
        for kind in (CommonOptions, SimulationOptions, PlaceSeeds, TownOptions)
        for field in fields(kind)
        if field.name not in ("render_mode", "render_tracks", "seed", *WRITING_OPTIONS)
    ],
}


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """The content of a scenario file.

    Attributes:
        content: all of it, as plain data.
        scenario: the scenario to start from: its name, or a place that the file describes.
        keywords: keywords of `coopsim.parallel_env`.
        situation: class of the situation; None: there is none.
    """

    content: Section
    scenario: str | Place
    keywords: Mapping[str, Any]
    situation: type[Situation] | None = None

    def blame(self, error: CoopsimError, overridden: Collection[str] = ()) -> CoopsimError:
        """Return the error with the file and the line of the key that it names.

        Args:
            error: the error.
            overridden: keys whose values are not the file's. An error that names no key of the file may be their fault:
                it is then returned as it is.
        """
        path = str(self.content.file)
        if error.place is not None:
            return ScenarioFileError(str(error)) if error.place.startswith(f"{path}:") else error
        place = self.content.blame(error, overridden) or (None if overridden else path)
        return error if place is None else ScenarioFileError(str(error)).at(place)


def find_scenario_file(path: str | Path) -> Path:
    """Return the file at `path`, or the shipped file of that name.

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
    """Read a file and check its keys; values are checked when an environment is made.

    Raises:
        ScenarioFileError: names the file and, where known, the line.
    """
    root = read_yaml(find_scenario_file(path), ScenarioFileError)
    belongs = {name: f"below {section}" for section, names in _SECTIONS.items() for name in names}
    belongs |= dict.fromkeys(WRITING_OPTIONS, "to the command or call: a file does not say where to write")
    top = root.fields((), (*_TOP, *_SECTIONS), belongs)
    for section, names in _SECTIONS.items():
        if section in top:
            top[section].fields((), names, belongs | dict.fromkeys(_TOP, "to the top of the file, not below a key"))
    content: Section = root.value
    for key in content:
        if key != "place" and (code := code_in(content[key])) is not None:  # a place names no parts
            what = f"{key} must not name code to run, got {code!r}: give it to the command or call"
            raise ScenarioFileError(what).at(content.place(key))
    keywords = {name: content[name] for name in ("density", "seed") if name in content}
    for section in _SECTIONS:
        keywords |= content[section].with_paths() if section in content else {}
    if "situation" in top:
        kind, scenario, own = _situation(root, top)
        return ScenarioFile(content, scenario, keywords | own, kind)
    return ScenarioFile(content, _scenario(root, top), keywords)


def write_scenario_file(path: str | Path, description: PlaceDescription | Mapping[str, Any], **content: Any) -> Path:
    """Write a scenario file with a place that reads back to the same numbers, bit by bit.

    Args:
        path: the file; an older one is replaced.
        description: description of the place, as `Place.description`, or plain data as in a file.
        **content: other keys of the file, such as `population` and `options`, as plain data.

    Raises:
        UnknownNameError: there is no such key.
        ScenarioFileError: the file cannot be written.
    """
    for name in content:
        require_choice("key", name, (*_TOP, *_SECTIONS))
    return write_place_file(path, description, content)


def _situation(root: FileEntry, top: Mapping[str, Entry]) -> tuple[type[Situation], str | Place, dict[str, Any]]:
    """Return the class of the file's situation, its place, and its own keywords."""
    for name in ("population", "density"):
        if name in top:
            raise top[name].error(f"{name} must be left out with situation, which says who is there")
    entry = top["situation"]
    named = entry.named("Accepted: name and fields of a situation, or roles")
    place = _scenario(root, top) if "place" in top or "scenario" in top else NAMED
    if "name" not in named:
        layout = _fixed_layout(root, top, place)
        given = {name: entry.value[name] for name in named if name not in ROLE_KEYS}
        return WrittenSituation, place, given | {"place": place, "roles": read_roles(entry, layout)}
    kind = SITUATIONS.get(named["name"].choice(SITUATIONS.names(), "situation"))
    own = [field.name for field in fields(kind) if field.name not in ("place", "detail")]
    entry.fields(("name",), own, {"place": "to the top of the file", "detail": "below options"})
    return kind, place, {name: entry.value[name] for name in named if name != "name"} | {"place": place}


def _fixed_layout(root: FileEntry, top: Mapping[str, Entry], place: str | Place) -> Layout:
    """Return the layout that the roles of a file are in."""
    if place in (NAMED, TOWN):
        named = top.get("scenario", root)
        raise named.error("scenario must be a place that is always the same, or place must describe one, for roles")
    return place.make_layout() if isinstance(place, Place) else SCENARIOS.get(place).make_layout()


def _scenario(root: FileEntry, top: Mapping[str, Entry]) -> str | Place:
    """Return the scenario that the file names, or the place that it describes."""
    if "place" in top and "scenario" in top:
        raise top["place"].error("place takes the place of scenario: one of them is accepted")
    if "place" in top:
        checksum = zlib.crc32(repr(top["place"].value).encode())  # tells it from other places of that name
        return read_place(top["place"], f"{root.file.stem}-{checksum:08x}")
    if "scenario" not in top:
        raise root.error(f"scenario is missing. Accepted: {', '.join(scenario_names())}; or place, with custom roads")
    return top["scenario"].choice(scenario_names())
