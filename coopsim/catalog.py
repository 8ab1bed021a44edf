"""Policies and environments by name. Both live outside the library, which finds them when first asked."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv

NAMESPACE = "coopsim"

ENVIRONMENTS_HOME = "coopsim.envs"

SCENARIO_SUFFIXES = (".yaml", ".yml")

POLICIES: Registry[type[Policy]] = Registry("policy", home="coopsim.agents", group="coopsim.policies")
"""Policy classes; an installed package adds its own through the entry-point group `coopsim.policies`."""

ENVIRONMENTS: Registry[Callable[..., CooperativeEnv]] = Registry("environment", home=ENVIRONMENTS_HOME)
"""Functions that make an environment, by versioned name (`crossing-v0`)."""


def make_policy(name: str, /, **parameters: Any) -> Policy:
    """The policy called `name`, made with `parameters`.

    Raises:
        UnknownNameError: no such policy, or it has no such parameter; the message lists the close ones.
        InvalidValueError: a parameter's value is not accepted, or one that the policy needs is missing.
    """
    return instantiate(name, POLICIES.get(name), parameters)


def instantiate(name: str, policy: type[Policy], parameters: Mapping[str, Any]) -> Policy:
    """A policy of that class, which the user knows as `name`; raises as `make_policy` does."""
    signature = inspect.signature(policy)
    kinds = {parameter.name: parameter.kind for parameter in signature.parameters.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds.values():
        for parameter in parameters:
            require_choice(f"parameter of policy {name!r}", parameter, kinds)
    if inspect.isabstract(policy):
        missing = ", ".join(sorted(policy.__abstractmethods__))
        raise InvalidValueError(f"policy {name!r} cannot be made: its class has no {missing}")
    try:
        signature.bind(**parameters)
    except TypeError as error:
        raise InvalidValueError(f"policy {name!r}: {error}") from error
    return policy(**parameters)


def parallel_env(name: str | Path, /, **options: Any) -> CooperativeEnv:
    """The environment called `name`.

    Args:
        name: `crossing` (its newest version), `crossing-v0`, the PettingZoo id `coopsim/crossing-v0`, or the path of a
            scenario file (`.yaml`).
        **options: see `coopsim.envs.options` and the scenario's own numbers.

    Raises:
        UnknownNameError: no such environment or option; the message lists the close ones.
        InvalidValueError: an option's value is not accepted.
        ScenarioFileError: a scenario file is missing or broken.
    """
    if isinstance(name, Path) or is_scenario_file(name):
        return ENVIRONMENTS.get("file-v0")(path=name, **options)
    known = newest(name.removeprefix(f"{NAMESPACE}/")) if isinstance(name, str) else name
    return ENVIRONMENTS.get(known)(**options)


def is_scenario_file(name: object) -> bool:
    """Whether that is the path of a scenario file, and not the name of an environment."""
    return isinstance(name, Path) or str(name).lower().endswith(SCENARIO_SUFFIXES)


def scenario_file_options(path: str | Path) -> Mapping[str, Any]:
    """What a scenario file sets, as keywords of `parallel_env`; raises as that does."""
    options: Mapping[str, Any] = _scenario_files().load_scenario_file(path).keywords
    return options


def usual_seed(environment: str | Path) -> int:
    """Of an episode for which nobody gives one: what a scenario file says, else 0; raises as `parallel_env` does."""
    seed: int | None = scenario_file_options(environment).get("seed") if is_scenario_file(environment) else None
    return 0 if seed is None else seed


def scenario_files() -> list[str]:
    """Names of the scenario files that come along."""
    return sorted(path.name for path in _scenario_files().SHIPPED.glob("*.yaml"))


def _scenario_files() -> ModuleType:
    return importlib.import_module(f"{ENVIRONMENTS_HOME}.scenario_file")


def newest(name: str) -> str:
    """`name` itself if it has a version or is unknown, else its newest version."""
    versions = [
        (int(match[1]), known) for known in ENVIRONMENTS if (match := re.fullmatch(re.escape(name) + r"-v(\d+)", known))
    ]
    return max(versions)[1] if versions else name
