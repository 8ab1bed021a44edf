"""Drawn towns as scenario files."""

from __future__ import annotations

from pathlib import Path

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import write_place_file
from coopsim.world.scenario import Scenario
from coopsim.world.towns.place_seeds import PlaceSeeds
from coopsim.world.towns.streets.town_options import TownOptions
from coopsim.world.towns.town_scenarios import TownScenarios


def draw_town(place_seed: int, options: TownOptions) -> Scenario:
    """Draw a town with its usual population."""
    return TownScenarios(PlaceSeeds(place_seed), options, 1.0, None, {}).of(place_seed)


def write_town(path: Path, town: Scenario) -> Path:
    """Write a drawn town as a scenario file, whose episodes are those of the drawn one, bit by bit.

    Raises:
        InvalidValueError: it is no drawn town, or the name is not that of a scenario file.
        ScenarioFileError: the file cannot be written.
    """
    if town.description is None:
        raise InvalidValueError(f"town must be a scenario with a description, got {town.name!r}, which has none")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InvalidValueError(f"path of a scenario file must end in .yaml, got {str(path)!r}")
    content = {"population": town.population.numbers, "options": {"detail": town.detail}}
    return write_place_file(path, town.description, content)
