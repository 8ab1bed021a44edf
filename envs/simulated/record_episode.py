"""Recorded traffic: scenarios are recorded, and environments play recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coopsim.catalog import is_scenario_file
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.errors import CoopsimError, InvalidValueError, RecordingError
from coopsim.support.checks import require_count
from coopsim.world.population import drop_overridden
from coopsim.world.recording import recorded_world
from coopsim.world.recording.episode_file import Episode
from coopsim.world.scenario import NUMBERS, Place
from coopsim.world.towns.scenarios import TOWN, TOWN_KEYS

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
    if file.situation is not None:
        raise file.blame(InvalidValueError("situation cannot be recorded so: use record, an option of environments"))
    keywords = {name: value for name, value in file.keywords.items() if name in _OF_THE_WORLD}
    try:
        return recorded_world.record(file.scenario, path, **{**drop_overridden(keywords, options), **options})
    except CoopsimError as error:
        raise file.blame(error, overridden={"path", *options}) from error


def as_recorded(episode: Episode, scenario: str | Place, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options with the recording's population, `dt_s` and (unless fewer are asked for) `max_cycles`.

    Raises:
        RecordingError: the recording is of another scenario, of one that does not exist, or has a single frame.
        InvalidValueError: an option differs from the recorded one.
    """
    header, steps = episode.header, episode.frames - 1
    name = scenario.name if isinstance(scenario, Place) else scenario
    if header.scenario != name and (name != TOWN or header.description is None):
        hint = "" if header.description is None else f", or {TOWN!r}, which plays all recordings that carry their place"
        raise RecordingError(f"{episode.path} was recorded in {header.scenario!r}; accepted here: {name!r}{hint}")
    for key in TOWN_KEYS:
        if options.get(key) is not None:
            raise InvalidValueError(f"{key} must be left out with playback: {episode.path} carries its place")
    if not steps:
        raise RecordingError(f"{episode.path} holds a single frame and no step; accepted: at least two frames")
    asked = options.get("max_cycles", steps)
    require_count(1, max_cycles=asked)
    if asked > steps:
        raise InvalidValueError(f"max_cycles must be at most {steps}, as {episode.path} has no more steps, got {asked}")
    fixed = {**header.population, "dt_s": header.dt_s, "detail": header.detail}
    for name, value in fixed.items():
        if options.get(name, value) != value and (name, options[name]) != ("detail", None):
            raise InvalidValueError(f"{name} must be {value!r}, as {episode.path} was recorded, got {options[name]!r}")
    return {**options, **fixed, "max_cycles": asked}
