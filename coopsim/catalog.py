"""Policies and environments by name. Both live outside the library, which imports them at the first look-up."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.registry import Registry

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv
    from coopsim.envs.single.cast import Others, PolicyLike
    from coopsim.envs.single.single_agent_env import SingleAgentEnv
    from coopsim.world.scenario import Place

NAMESPACE = "coopsim"

ENVIRONMENTS_HOME = "coopsim.envs"

SCENARIO_SUFFIXES = (".yaml", ".yml")

WRITING_OPTIONS = ("record",)
"""Options of environments that name a path to write: users alone give them, no file does."""

POLICIES: Registry[type[Policy]] = Registry("policy", home="coopsim.agents", group="coopsim.policies")
"""Policy classes. Installed packages add theirs through the entry-point group `coopsim.policies`."""

ENVIRONMENTS: Registry[Callable[..., CooperativeEnv]] = Registry("environment", home=ENVIRONMENTS_HOME)
"""Factories of environments, by versioned name (`crossing-v2`)."""


def make_policy(name: str, /, **parameters: Any) -> Policy:
    """Make the policy called `name` with `parameters`.

    Args:
        name: also with parameters, as "late_fusion(hits=2)".
        **parameters: further ones.

    Raises:
        UnknownNameError: there is no such policy, or no such parameter; the message lists the close ones.
        InvalidValueError: a parameter's value is not accepted, is given twice, or a required one is missing.
    """
    if not isinstance(name, str):  # callers may ignore the annotation
        raise UnknownNameError("policy", name, POLICIES.names())
    registered, written = parse_spec("policy", name)
    for twice in parameters.keys() & written.keys():
        raise InvalidValueError(f"{twice} must be given once, got {name!r} and {twice}={parameters[twice]!r}")
    return instantiate("policy", registered, POLICIES.get(registered), written | parameters)


def policies_on_boxes() -> tuple[str, ...]:
    """Return the names of the policies that read no sensor data: those that can run on recordings of detections."""
    needs = {name: POLICIES.get(name).needs for name in POLICIES.names()}
    return tuple(name for name, each in needs.items() if not (each.lidar or each.cameras))


def parallel_env(name: str | Path, /, **options: Any) -> CooperativeEnv:
    """Make the environment called `name`.

    Args:
        name: `crossing` (its newest version), `crossing-v2`, the PettingZoo id `coopsim/crossing-v2`, the path of a
            scenario file (`.yaml`), or that of a folder of recordings.
        **options: of every environment (`coopsim.envs.options`), of simulated ones (`coopsim.envs.simulated.
            simulation_options`), of the population (`coopsim.world.population`), and of drawn towns
            (`coopsim.world.towns.options`).

    Raises:
        UnknownNameError: no such environment or option; the message lists the close ones.
        InvalidValueError: an option's value is not accepted.
        ScenarioFileError: a scenario file is missing or broken.
    """
    if is_recordings_folder(name):
        return ENVIRONMENTS.get(newest("replay"))(path=name, **options)
    if isinstance(name, Path) or is_scenario_file(name):
        return ENVIRONMENTS.get(newest("file"))(path=name, **options)
    known = newest(name.removeprefix(f"{NAMESPACE}/")) if isinstance(name, str) else name
    return ENVIRONMENTS.get(known)(**options)


def single_env(
    name: str | Path,
    /,
    *,
    ego: str | None = None,
    others: Others = None,
    tracker: PolicyLike = None,
    **options: Any,
) -> SingleAgentEnv:
    """Make the environment called `name` for one agent that learns, with gymnasium's API; the others follow policies.

    Args:
        name: as of `parallel_env`.
        ego: name of the agent that acts; None: the first one.
        others: the policy of the other agents, by name, spec or object; a mapping of agents to such policies; or None:
            they report nothing.
        tracker: a policy that reports the ego's tracks, so that the learner only drives; needs `control="policy"`.
        **options: as of `parallel_env`.

    Raises:
        CoopsimError: as `parallel_env` and `coopsim.envs.single.single_agent_env.SingleAgentEnv` do.
    """
    home = importlib.import_module(f"{ENVIRONMENTS_HOME}.single.single_agent_env")
    env: SingleAgentEnv = home.SingleAgentEnv(name, ego=ego, others=others, tracker=tracker, **options)
    return env


def refuse_writing(options: Mapping[str, Any], where: str) -> None:
    """Refuse options that name a path to write, from anybody but the user.

    Args:
        options: of an environment, from a file.
        where: the file, for the error.

    Raises:
        InvalidValueError: there is such an option.
    """
    for name in WRITING_OPTIONS:
        if options.get(name) is not None:
            raise InvalidValueError(f"{where} must not say which file to write, got {name}: {options[name]!r}")


def is_scenario_file(name: object) -> bool:
    """Return whether `name` is the path of a scenario file, and not the name of an environment, nor a folder."""
    if isinstance(name, (str, Path)) and Path(name).is_dir():
        return False
    return isinstance(name, Path) or str(name).lower().endswith(SCENARIO_SUFFIXES)


def is_recordings_folder(name: object) -> bool:
    """Return whether `name` is the path of a folder, as recordings are, and not the name of an environment."""
    if isinstance(name, str) and newest(name.removeprefix(f"{NAMESPACE}/")) in ENVIRONMENTS:
        return False
    return isinstance(name, (str, Path)) and name != "" and Path(name).is_dir()


def scenario_file_options(path: str | Path) -> Mapping[str, Any]:
    """Return the settings of a scenario file as keywords of `parallel_env`; raises as that does."""
    options: Mapping[str, Any] = _scenario_files().load_scenario_file(path).keywords
    return options


def scenario_of_file(path: str | Path) -> str | Place:
    """Return the scenario that a scenario file starts from: its name, or a custom place. Raises as `parallel_env`."""
    scenario: str | Place = _scenario_files().load_scenario_file(path).scenario
    return scenario


def usual_seed(environment: str | Path) -> int:
    """Return the default seed of an environment: the scenario file's, or 0. Raises as `parallel_env` does."""
    seed: int | None = scenario_file_options(environment).get("seed") if is_scenario_file(environment) else None
    return 0 if seed is None else seed


def scenario_files() -> list[str]:
    """Return the names of the scenario files that are shipped."""
    return sorted(path.name for path in _scenario_files().SHIPPED.glob("*.yaml"))


def _scenario_files() -> ModuleType:
    return importlib.import_module(f"{ENVIRONMENTS_HOME}.simulated.scenario_file")


def newest(name: str) -> str:
    """Return the newest version of an environment; `name` itself if it has a version or is unknown."""
    versions = [
        (int(match[1]), known) for known in ENVIRONMENTS if (match := re.fullmatch(re.escape(name) + r"-v(\d+)", known))
    ]
    return max(versions)[1] if versions else name
