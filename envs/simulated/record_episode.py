"""Recorded traffic: scenarios are recorded, and environments play recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from coopsim.catalog import is_scenario_file
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.errors import CoopsimError, InvalidValueError, RecordingError
from coopsim.support.checks import require_count, require_frame_time
from coopsim.support.rng import require_seed
from coopsim.world.custom.place import place_from
from coopsim.world.drawn_places import TOWN, TOWN_KEYS, choose_scenarios
from coopsim.world.population import drop_overridden
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import RecordedWorld
from coopsim.world.scenario import NUMBERS, EpisodeScenarios, Place, SameScenario, Scenario, make_scenario
from coopsim.world.world import World

_OF_THE_WORLD = {"seed", "dt_s", "detail", *NUMBERS, *TOWN_KEYS}


def record(scenario: str | Path | Place, path: str | Path, **options: Any) -> Path:
    """Simulate a world and record it, without sensing.

    Args:
        scenario: name of the scenario, such as "crossing" or "town"; path of a scenario file, of which the place, its
            options, the numbers, `density`, `detail`, `seed` and `dt_s` are used; or a custom place.
        path: the file; an older one is replaced.
        **options: `seed`, `max_cycles`, `dt_s`, `density`, `detail`, fields of `Population` and options of towns, see
            `coopsim.world.drawn_options`; they override the scenario file's.

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a value is not accepted, or the file cannot be written.
        ScenarioFileError: the scenario file is missing or broken; names the line.
    """
    if isinstance(scenario, Place) or not is_scenario_file(scenario):
        return _record_place(scenario if isinstance(scenario, Place) else str(scenario), path, **options)
    file = load_scenario_file(scenario)
    if file.situation is not None:
        raise file.blame(InvalidValueError("situation cannot be recorded so: use record, an option of environments"))
    keywords = {name: value for name, value in file.keywords.items() if name in _OF_THE_WORLD}
    try:
        return _record_place(file.scenario, path, **{**drop_overridden(keywords, options), **options})
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


def _record_place(
    scenario: str | Place,
    path: str | Path,
    *,
    seed: int = 0,
    max_cycles: int = 200,
    dt_s: float = 0.1,
    **numbers: Any,
) -> Path:
    """Simulate the world of a scenario, and record it.

    Args:
        scenario: name of the scenario, such as "crossing" or "town", or a custom place.
        path: the file; an older one is replaced.
        seed: decides everything that happens.
        max_cycles: steps; the file has one frame more.
        dt_s: time between two frames.
        **numbers: `density`, `detail`, fields of `Population`, and the options of towns.

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a value is not accepted, or the file cannot be written.
    """
    require_seed(seed)
    require_count(1, max_cycles=max_cycles)
    require_frame_time(dt_s)
    place = choose_scenarios(scenario, **numbers).of(seed)
    world = RecordedWorld(World(place, seed), path, place, seed, dt_s)
    for _ in range(max_cycles):
        world.step(dt_s)
    return Path(path)


def recorded_scenario(episode: Episode, place: str | Place | None = None) -> Scenario:
    """Return the scenario that an episode was recorded in.

    Without a place it is the one that the recording carries, or else the registered scenario of its name.

    Raises:
        RecordingError: the scenario does not exist, or does not accept the population.
    """
    header = episode.header
    try:
        if place is None and header.description is not None:
            place = place_from(header.description, header.scenario)
        found = make_scenario(place or header.scenario, detail=header.detail, **header.population)
        return replace(found, place_seed=header.place_seed)
    except (LookupError, ValueError) as error:
        raise RecordingError(f"{episode.path} was recorded in a scenario that is not to be had: {error}") from error


def played_scenarios(episode: Episode, place: Place | None = None) -> EpisodeScenarios:
    """Return the scenario of a recording for all episodes; arguments and errors are those of `recorded_scenario`."""
    return SameScenario(recorded_scenario(episode, place))
