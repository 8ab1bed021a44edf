"""Makers of environments: from options, names of places and situations, files and recordings to a `CooperativeEnv`.

`coopsim.catalog.ENVIRONMENTS` loads them at its first look-up, and asks for `make_maker` by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from coopsim.catalog import ENVIRONMENTS, VERSION
from coopsim.envs.frames import FrameSource
from coopsim.envs.options import CommonOptions, require_truth_exposed, sort_options
from coopsim.envs.parallel import CooperativeEnv
from coopsim.envs.replay import Replay, TextOptions
from coopsim.envs.rewards import RewardOption
from coopsim.envs.sensor_replay import RecordedOptions, SensorReplay
from coopsim.envs.simulated.record_episode import as_recorded, played_scenarios
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.envs.simulated.simulation import Simulation
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import CoopsimError, DuplicateNameError, InvalidValueError
from coopsim.recordings.formats import AUTO, TEXT, find_format, formats, open_folder
from coopsim.support.checks import require_choice
from coopsim.world.drawn_places import (
    LIVE_TRAFFIC,
    TOWN_KEYS,
    choose_scenarios,
    find_drawer,
    is_live,
    is_place_file,
    scenario_names,
)
from coopsim.world.places.description import PlaceDescription
from coopsim.world.population import Population, drop_overridden
from coopsim.world.recording.episode_file import Episode
from coopsim.world.scenario import NUMBERS, SCENARIOS, Place
from coopsim.world.situations.situation import EGO, SITUATIONS, Situation


def simulation_env(
    scenario: str | Place, name: str, /, *, density: float = 1.0, reward: RewardOption = None, **options: Any
) -> CooperativeEnv:
    """Make a simulated environment.

    Args:
        scenario: name of the scenario, path of a file of places, or a custom place; "town" and such files draw a place
            for each episode.
        name: the environment's id.
        density: a factor on the numbers of vehicles and people.
        reward: reward by name or as an object, see `coopsim.envs.rewards`; None is "mota".
        **options: fields of `CommonOptions`, `SimulationOptions` and `Population`; for drawn places also those of
            `DrawnPlaces.kinds`.
    """
    drawer = find_drawer(scenario)
    if is_live(options.get("traffic")):
        drawer = LIVE_TRAFFIC.get(options["traffic"])(scenario, options.get("dt_s", SimulationOptions().dt_s))
    groups = (CommonOptions, SimulationOptions, Population, *(() if drawer is None else drawer.kinds))
    if drawer is None:
        _refuse_town_keys(scenario, options)
    sort_options(options, *groups, also_accepted=["density", "reward"])  # refuses typos before a recording is read
    playback = options.get("playback")
    episode = None if playback is None else Episode(playback)
    if episode is not None:
        if density != 1.0:
            raise InvalidValueError(f"density must be 1, as {playback} has its own numbers, got {density!r}")
        options = as_recorded(episode, scenario, options)
    common, simulation, *numbers = sort_options(options, *groups, also_accepted=["density", "reward"])
    shared = CommonOptions(**common)
    sensed = SimulationOptions(**simulation)
    require_truth_exposed(sensed.camera_modes, exposed=shared.expose_ground_truth)
    if episode is not None:
        place = scenario if isinstance(scenario, Place) else None
        return CooperativeEnv(Simulation(name, played_scenarios(episode, place), sensed, episode), shared, reward)
    asked = {key: value for group in numbers for key, value in group.items()}
    scenarios = choose_scenarios(scenario, density=density, detail=sensed.detail, drawer=drawer, **asked)
    try:
        return CooperativeEnv(Simulation(name, scenarios, sensed), shared, reward)
    except CoopsimError:
        scenarios.close()
        raise


def situation_env(
    situation: str | type[Situation], name: str, /, *, reward: RewardOption = None, **options: Any
) -> CooperativeEnv:
    """Make the environment of a situation.

    Unless other options are given, a planner drives the ego, `cav_0`, by its reported tracks; the others follow the
    traffic model; and an episode ends at the ego's crash, or when the situation is over.

    Args:
        situation: name of the situation, or a class of situations.
        name: the environment's id.
        reward: reward by name or as an object, see `coopsim.envs.rewards`; None is "mota".
        **options: fields of `CommonOptions`, `SimulationOptions` and of the situation's class.
    """
    kind = SITUATIONS.get(situation) if isinstance(situation, str) else situation
    common, simulation, own = sort_options(options, CommonOptions, SimulationOptions, kind, also_accepted=["reward"])
    if simulation.get("playback") is not None:
        raise InvalidValueError("playback must be left out in a situation, whose cars react: play it in its place")
    shared = CommonOptions(**common)
    staged = kind(**own)
    usual: dict[str, Any] = {"control": "planner"}
    if simulation.get("control") != "traffic":
        usual |= {"driven_agents": (EGO,), "ends_on_crash": True, **kind.usual}
    sensed = SimulationOptions(**usual | simulation)
    if "max_cycles" not in simulation:
        sensed = replace(sensed, max_cycles=math.ceil(staged.over_s / sensed.dt_s - 1e-9))
    require_truth_exposed(sensed.camera_modes, exposed=shared.expose_ground_truth)
    return CooperativeEnv(Simulation(name, staged, sensed), shared, reward)


def _refuse_town_keys(scenario: str | Place, options: Mapping[str, Any]) -> None:
    """Say whose options those of towns are, as one may give them to a file that was written from a town."""
    why = "the place of a file is fixed" if isinstance(scenario, Place) else f"{scenario!r} is always the same place"
    for name in options:
        if name in TOWN_KEYS:
            raise InvalidValueError(f"{name} is an option of 'town', which draws places, and must be left out: {why}")


def file_env(name: str, /, *, path: str | Path | None = None, **options: Any) -> CooperativeEnv:
    """Make a simulated environment from a scenario file; see `coopsim.envs.simulated.scenario_file`.

    Args:
        name: the environment's id.
        path: scenario file, or the name of one that ships with coopsim; or a file of places, such as a map; there is no
            default.
        **options: options of `simulation_env`; they override the file's.

    Raises:
        ScenarioFileError: the file is not accepted; the message names file and line.
    """
    if not isinstance(path, (str, Path)):
        raise InvalidValueError(f"path must be that of a scenario file, got {path!r}")
    if is_place_file(path):
        return simulation_env(str(path), name, **options)
    file = load_scenario_file(path)
    try:
        if file.situation is not None:
            return situation_env(file.situation, name, **{**file.keywords, **options})
        keywords = drop_overridden(file.keywords, options)
        if options.get("playback", keywords.get("playback")) is not None:  # a recording has its own population
            keywords = {key: value for key, value in keywords.items() if key not in (*NUMBERS, "detail", *TOWN_KEYS)}
        return simulation_env(file.scenario, name, **{**keywords, **options})
    except CoopsimError as error:
        raise file.blame(error, overridden=options) from error


def replay_env(
    name: str,
    /,
    *,
    path: str | Path | None = None,
    format: str = AUTO,  # noqa: A002  (the word for it)
    reward: RewardOption = None,
    **options: Any,
) -> CooperativeEnv:
    """Make an environment from a folder of recordings: of detections in text files, or with sweeps.

    Args:
        name: the environment's id.
        path: the folder; there is no default.
        format: format of the folder: "text", or one of `coopsim.recordings.formats.RECORDINGS`, such as "opv2v"
            (V2XSet, too) and "nuscenes"; "auto" finds it.
        reward: reward by name or as an object, see `coopsim.envs.rewards`; None is "mota".
        **options: fields of `CommonOptions` and of `TextOptions` (see `Replay`) or `RecordedOptions`, by the format.
    """
    require_choice("format", format, formats())
    found = format
    if path is None:  # said by what asks for a path
        found = TEXT
    elif format == AUTO:
        found = find_format(path)
    own = TextOptions if found == TEXT else RecordedOptions
    common, given = sort_options(options, CommonOptions, own, also_accepted=["path", "format", "reward"])
    shared = CommonOptions(**common)
    if found == TEXT:
        text = TextOptions(**given)
        source: FrameSource = Replay(name, path, text.detections, text.dt_s, text.odometry, text.axes)
    else:
        recorded = RecordedOptions(**given)
        source = SensorReplay(name, open_folder(str(path), recorded.reading, found), recorded)
    return CooperativeEnv(source, shared, reward)


def makers() -> dict[str, Callable[..., CooperativeEnv]]:
    """Return the makers of all environments that there are now, by name."""
    return {
        **{name: partial(simulation_env, name) for name in scenario_names()},
        **{name: partial(situation_env, name) for name in SITUATIONS},
        "file": file_env,
        "replay": replay_env,
    }


def register_place(name: str, place: PlaceDescription | Callable[[], PlaceDescription]) -> None:
    """Register a place by name: `coopsim.parallel_env(name)` makes an environment in it from then on.

    Installed packages need not call this: the entry-point group `coopsim.places` has names and descriptions, too.

    Args:
        name: name of the scenario; its environment is `coopsim/<name>-v3`.
        place: its description, or a function that returns it when the place is first used.

    Raises:
        DuplicateNameError: there is a scenario or an environment of that name.
        InvalidValueError: it is neither.
    """
    if not isinstance(place, PlaceDescription) and not callable(place):
        raise InvalidValueError(
            f"place must be a PlaceDescription, or a function that returns one, got {type(place).__name__}"
        )
    versioned = f"{name}-v{VERSION}"
    if versioned in ENVIRONMENTS:
        raise DuplicateNameError(f"environment {versioned!r} is already registered")
    known: Any = place
    SCENARIOS.register(name)(known)
    ENVIRONMENTS.names()  # gymnasium and PettingZoo, too, know it from now on
