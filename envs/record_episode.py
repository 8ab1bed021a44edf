"""Recording the traffic of a scenario, of one that is described by a file, too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from coopsim.catalog import is_scenario_file
from coopsim.envs.scenario_file import load_scenario_file
from coopsim.errors import CoopsimError
from coopsim.world.population import beside
from coopsim.world.recording import recorded_world
from coopsim.world.scenario import NUMBERS, Place

_OF_THE_WORLD = {"seed", "dt_s", *NUMBERS}


def record(scenario: str | Path | Place, path: str | Path, **options: Any) -> Path:
    """Let a world happen and record it, without sensing anything.

    Args:
        scenario: name of the scenario, as "crossing"; the path of a scenario file, of which its place, its numbers,
            `density`, `seed` and `dt_s` count; or a place of one's own.
        path: the file; an older one is replaced.
        **options: `seed`, `max_cycles`, `dt_s`, `density` and fields of `Population`, see
            `coopsim.world.recording.recorded_world.record`; they go before what the scenario file says.

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a value is not accepted, or the file cannot be written.
        ScenarioFileError: the scenario file is missing or broken; names the line.
    """
    if isinstance(scenario, Place) or not is_scenario_file(scenario):
        return recorded_world.record(scenario if isinstance(scenario, Place) else str(scenario), path, **options)
    file = load_scenario_file(scenario)
    own = {name: value for name, value in file.keywords.items() if name in _OF_THE_WORLD}
    try:
        return recorded_world.record(file.scenario, path, **{**beside(own, options), **options})
    except CoopsimError as error:
        raise file.blame(error, beside={"path", *options}) from error
