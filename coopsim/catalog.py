"""Policies, environments and rewards by name, and policies by the place of their class.

All live outside the library, which imports them at the first look-up. A user writes a policy down as

| text | meaning |
|---|---|
| `late_fusion` | a registered policy |
| `late_fusion(delayed=replay, hits=2)` | the same with parameters, see `coopsim.config.spec` |
| `mypackage.module:MyTracker` | a class of an installed package |
| `path/to/file.py:MyTracker` | a class in a file, which may import modules beside it |
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register, registry

from coopsim.config.spec import instantiate, parse_spec, spell_spec
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.support.printable import require_printable
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at, describe, names_file, read_source

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv
    from coopsim.world.scenario import Place


NAMESPACE = "coopsim"

SCENARIO_SUFFIXES = (".yaml", ".yml")

WRITING_OPTIONS = ("record",)
"""Options of environments that name a path to write: users alone give them, no file does."""

POLICIES: Registry[type[Policy]] = Registry(
    "policy", home=("coopsim.agents", "coopsim.agents.networks"), group="coopsim.policies"
)
"""Policy classes. Installed packages add theirs through the entry-point group `coopsim.policies`."""

VERSION = 3
"""Version of all environments; any change of observations, rewards or dynamics raises it.

| version | change |
|---|---|
| 0 | first |
| 1 | the default detector is the one fitted to V2V4Real, and confuses classes; `ground_truth` has all objects |
| 2 | simulated detections have no order, and false ones heights as real ones; towns are the same on every processor |
| 3 | the default detector's fit no longer takes found objects for missed ones |
"""


class _Environments(Registry["Callable[..., CooperativeEnv]"]):
    """Environments, of which each place and each situation that is registered is one."""

    def _load_home(self) -> None:
        makers = importlib.import_module("coopsim.envs.makers").makers()
        for name, make in makers.items():
            versioned = f"{name}-v{VERSION}"
            if versioned not in self._entries:
                made = self.register(versioned)(partial(make, f"{NAMESPACE}/{versioned}"))
                register_with_gymnasium(versioned)
                if versioned not in VERSIONED_NAMES:  # which `coopsim.envs` registers
                    pettingzoo = importlib.import_module("pettingzoo")
                    pettingzoo.register("parallel", f"{NAMESPACE}/{versioned}", made)


ENVIRONMENTS: Registry[Callable[..., CooperativeEnv]] = _Environments("environment")
"""Factories of environments, by versioned name (`crossing-v3`). Those of places and situations are made of these."""

REWARDS: Registry[type[Any]] = Registry(
    "reward", home=("coopsim.envs.rewards", "coopsim.envs.message_gain"), group="coopsim.rewards"
)
"""Reward classes. Installed packages add theirs through the entry-point group `coopsim.rewards`."""


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
    """Return the names of the policies that read neither sensor data nor the truth, and so run on recorded boxes."""
    needs = {name: POLICIES.get(name).needs for name in POLICIES.names()}
    return tuple(name for name, each in needs.items() if not (each.lidar or each.cameras or each.truth))


def parallel_env(name: str | Path, /, **options: Any) -> CooperativeEnv:
    """Make the environment called `name`.

    Args:
        name: `crossing` (its newest version), `crossing-v3`, the PettingZoo id `coopsim/crossing-v3`, the path of a
            scenario file (`.yaml`), of a file of places, such as a map (`coopsim.world.drawn_places`), or that of a
            folder of recordings. Names may have options: "interaction(kind=cut_in)".
        **options: options of every environment (`coopsim.envs.options`), of simulated ones
            (`coopsim.envs.simulated.simulation_options`), of the population (`coopsim.world.population`), and of drawn
            towns (`coopsim.world.drawn_options`).

    Raises:
        UnknownNameError: no such environment or option; the message lists the close ones.
        InvalidValueError: an option's value is not accepted.
        ScenarioFileError: a scenario file is missing or broken.
    """
    require_printable(environment=str(name))
    if is_recordings_folder(name):
        return ENVIRONMENTS.get(newest("replay"))(path=name, **options)
    if isinstance(name, Path) or is_scenario_file(name) or is_place_file(name):
        return ENVIRONMENTS.get(newest("file"))(path=name, **options)
    if isinstance(name, str) and name.endswith(")"):
        name, written = parse_spec("environment", name)
        return parallel_env(name, **written | options)
    known = newest(name.removeprefix(f"{NAMESPACE}/")) if isinstance(name, str) else name
    return ENVIRONMENTS.get(known)(**options)


def refuse_writing(options: Mapping[str, Any], where: str) -> None:
    """Refuse options in the file `where` that name a path to write. Raises `InvalidValueError`."""
    for name in WRITING_OPTIONS:
        if options.get(name) is not None:
            raise InvalidValueError(f"{where} must not say which file to write, got {name}: {options[name]!r}")


def is_scenario_file(name: object) -> bool:
    """Return whether `name` is the path of a scenario file, and not the name of an environment, nor a folder."""
    if (isinstance(name, (str, Path)) and Path(name).is_dir()) or is_place_file(name):
        return False
    return isinstance(name, Path) or str(name).lower().endswith(SCENARIO_SUFFIXES)


def is_place_file(name: object) -> bool:
    """Return whether `name` is the path of a file of places, see `coopsim.world.drawn_places.is_place_file`."""
    if "." not in str(name):  # as names of scenarios: the world need not be loaded
        return False
    found: bool = importlib.import_module("coopsim.world.drawn_places").is_place_file(name)
    return found


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
    return sorted(path.name for path in scenario_folder().glob("*.yaml"))


def scenario_folder() -> Path:
    """Return the folder of the scenario files that are shipped."""
    return Path(_scenario_files().SHIPPED)


def _scenario_files() -> ModuleType:
    return importlib.import_module("coopsim.envs.simulated.scenario_file")


def newest(name: str) -> str:
    """Return the newest version of an environment; `name` itself if it has a version or is unknown."""
    versions = [
        (int(match[1]), known) for known in ENVIRONMENTS if (match := re.fullmatch(re.escape(name) + r"-v(\d+)", known))
    ]
    return max(versions)[1] if versions else name


_ACCEPTED = "name, name(parameter=value, ...) (in a YAML list in quotes), module:Class or file.py:Class"


@dataclass(frozen=True, slots=True)
class PolicySpec:
    """A policy and its parameters, as plain data that can be sent to another process or machine.

    Attributes:
        target: a registered name, `module:Class` or `file.py:Class`.
        parameters: parameters by name.
        source: text of the file, read once so that all runs use one version of it; None without a file.
    """

    target: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    source: str | None = None

    @classmethod
    def parse(cls, text: str) -> PolicySpec:
        """Parse the text of a user. Raises `InvalidValueError` for another shape, or an unreadable file."""
        target, parameters = parse_spec("policy", text, _ACCEPTED)
        if target.endswith(".py"):
            raise InvalidValueError(f"policy {text!r} must name the class in that file, as {target}:MyTracker")
        return cls(target, parameters, read_source(target) if names_file(target) else None)

    @property
    def text(self) -> str:
        """The one spelling of the policy with its parameters, as it stands in results."""
        return spell_spec(self.target, self.parameters)

    @property
    def place(self) -> str:
        """Module or file of the class; empty for a registered name."""
        return self.target.rpartition(":")[0]

    def policy_class(self) -> type[Policy]:
        """Look up the policy's class.

        Raises:
            CoopsimError: no class has that name, the module cannot be imported, or the name in it is not a policy
                class.
        """
        if ":" not in self.target:
            return POLICIES.get(self.target)
        return class_at("policy", self.target, _policy_base(), self.source)

    def make(self) -> Policy:
        """Make the policy with its parameters.

        Raises:
            CoopsimError: there is no such policy or parameter, or a value is not accepted.
        """
        try:
            return instantiate("policy", self.target, self.policy_class(), self.parameters)
        except CoopsimError:
            raise
        except Exception as error:  # a user's class may raise anything
            raise InvalidValueError(f"policy {self.text!r} cannot be made: {describe(error)}") from error


def _policy_base() -> type[Policy]:
    base: type[Policy] = importlib.import_module("coopsim.agents.policy").Policy
    return base


VERSIONED_NAMES = (
    "child_between_cars-v3",
    "crossing-v3",
    "crossing_path-v3",
    "file-v3",
    "highway-v3",
    "interaction-v3",
    "left_turn_across-v3",
    "merge-v3",
    "merge_barrier-v3",
    "occluded_crossing-v3",
    "occluded_pedestrian-v3",
    "overtaking-v3",
    "parking_street-v3",
    "platoon-v3",
    "queue_end-v3",
    "red_light_runner-v3",
    "replay-v3",
    "roundabout-v3",
    "route-v3",
    "t_junction-v3",
    "town-v3",
    "urban_grid-v3",
)
"""The environments that come with coopsim, as `ENVIRONMENTS` has them, whose look-up would load the simulator."""


def register_with_gymnasium(versioned: str) -> None:
    """Let `gymnasium.make` know an environment, unless it does already."""
    name = f"{NAMESPACE}/{versioned}"
    if name not in registry:
        register(name, "coopsim.envs.single_agent_env:SingleAgentEnv", kwargs={"environment": name})


DRIVE = f"{NAMESPACE}/drive-v1"
"""Environment of cars that are steered along routes, which has options of its own."""


def register_environments() -> None:
    """Let `gymnasium.make` know our environments: gymnasium 1 has no plug-ins that it would find by itself."""
    for versioned in VERSIONED_NAMES:
        register_with_gymnasium(versioned)
    if DRIVE not in registry:
        register(DRIVE, "coopsim.envs.drive.single:DriveEnv")
