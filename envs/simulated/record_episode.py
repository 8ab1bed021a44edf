"""Recording the traffic of scenarios, named ones and those from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from coopsim.catalog import is_scenario_file
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.errors import CoopsimError
from coopsim.world.population import drop_overridden
from coopsim.world.recording import recorded_world
from coopsim.world.scenario import NUMBERS, Place
from coopsim.world.towns.scenarios import TOWN_KEYS

_OF_THE_WORLD = {"seed", "dt_s", "detail", *NUMBERS, *TOWN_KEYS}


def record(scenario: str | Path | Place, path: str | Path, **options: Any) -> Path:
    """Simulate a world and record it, without sensing.

    Args:
        scenario: name of the scenario, such as "crossing" or "town"; path of a scenario file, of which the place, its
            options, the numbers, `density`, `detail`, `seed` and `dt_s` are used; or a custom place.
        path: the file; an older one is replaced.
        **options: `seed`, `max_cycles`, `dt_s`, `density`, `detail`, fields of `Population` and options of towns, see
            `coopsim.world.recording.recorded_world.record`; they override the scenario file's.

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a value is not accepted, or the file cannot be written.
        ScenarioFileError: the scenario file is missing or broken; names the line.
    """
    if isinstance(scenario, Place) or not is_scenario_file(scenario):
        return recorded_world.record(scenario if isinstance(scenario, Place) else str(scenario), path, **options)
    file = load_scenario_file(scenario)
    keywords = {name: value for name, value in file.keywords.items() if name in _OF_THE_WORLD}
    try:
        return recorded_world.record(file.scenario, path, **{**drop_overridden(keywords, options), **options})
    except CoopsimError as error:
        raise file.blame(error, overridden={"path", *options}) from error
