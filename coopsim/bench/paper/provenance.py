"""Provenance of a benchmark: all that others need to get the same numbers, but no date and no machine."""

from __future__ import annotations

import math
import platform
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Self

import coopsim
from coopsim.bench.grid.cell import Cell, environment_options
from coopsim.bench.grid.grid import ATTRIBUTES, Grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.store.packages import package_digest, package_versions
from coopsim.catalog import PolicySpec
from coopsim.config.load import load
from coopsim.errors import StoreError, UnknownNameError
from coopsim.provided import listening_env
from coopsim.support.precision import watch_weights

_INFINITE = "inf"
"""Infinity in JSON, which has no number for it."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """The origin of a benchmark's numbers, as plain data.

    Attributes:
        command: the command without what changes no number; empty for a call from Python.
        cells: number of cells of the grid; 0 if unknown.
        grid: attributes of `Grid`, by name.
        software: versions by name: coopsim, Python, and `package_versions`.
        commit: commit of coopsim's sources, with a word if they differ from it; empty if unknown.
        sources: digest of coopsim's sources and weights.
        sends: content that each policy's agents broadcast, by policy; "none" for no message.
        weights: names or paths of the weights that each policy loads, by policy.
        sensing: names or paths of the weights that the agents' detectors load.
        digests: digests of the weights, by name or path.
        training: `TrainingPlaces` of the weights as data, by name or path.
        left_out: policies that "all" does not stand for as their weights do not ship, with the reason.
        isolation: `Isolation.as_data`; empty: policies ran in the environment's process, by the seeds themselves.
    """

    command: str = ""
    cells: int = 0
    grid: Mapping[str, Any] = field(default_factory=dict)
    software: Mapping[str, str] = field(default_factory=dict)
    commit: str = ""
    sources: str = ""
    sends: Mapping[str, str] = field(default_factory=dict)
    weights: Mapping[str, list[str]] = field(default_factory=dict)
    sensing: list[str] = field(default_factory=list)
    digests: Mapping[str, str] = field(default_factory=dict)
    training: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    isolation: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, grid: Grid, command: str = "", isolation: Isolation = Isolation()) -> Self:  # noqa: B008  (frozen)
        """Find the provenance of a grid that `coopsim.bench.benchmark.check` has accepted."""
        sends, weights = {}, {}
        for text in grid.policies:
            with watch_weights() as found, isolation.described(PolicySpec.parse(text)) as policy:
                sends[text] = policy.needs.uplink
            weights[text] = sorted(found.values())
        with isolation.described(PolicySpec.parse(grid.policies[0])) as first, watch_weights() as sensing:
            for condition in {each.scenario: each for each in grid.conditions()}.values():
                cell = Cell(grid.policies[0], condition, grid.seeds[0], grid.frames)
                listening_env(condition.scenario, first, environment_options(cell, grid.options)).close()
        return cls(
            command,
            len(grid),
            {name: _plain(getattr(grid, name)) for name in ATTRIBUTES},
            {"coopsim": coopsim.__version__, "Python": platform.python_version(), **package_versions()},
            _commit(),
            package_digest("coopsim"),
            sends,
            weights,
            sorted(sensing.values()),
            **_described({*sensing.values(), *(name for names in weights.values() for name in names)}),
            left_out=dict(grid.left_out),
            isolation=isolation.as_data(),
        )

    @classmethod
    def from_data(cls, data: Mapping[str, Any] | None) -> Self:
        """Return the provenance of a store; an empty one if it has none. Raises `StoreError` for data of another
        version.
        """
        if data is None:
            return cls()
        try:
            made = cls(**data)
            return cls(**(asdict(made) | {"grid": {name: _numbers(each) for name, each in made.grid.items()}}))
        except (TypeError, AttributeError) as error:
            raise StoreError(f"the provenance of the results is broken: {error}") from error

    def as_data(self) -> dict[str, Any]:
        """Return the provenance as JSON has it."""
        return asdict(self)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple):
        return [_INFINITE if each == math.inf else each for each in value]
    return value


def _numbers(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _numbers(each) for name, each in value.items()}
    return [math.inf if each == _INFINITE else each for each in value] if isinstance(value, list) else value


def _described(names: set[str]) -> dict[str, dict[str, Any]]:
    """Return `digests` and `training` of weights."""
    if not names:
        return {}
    from coopsim.learn.weights import digest

    ordered = sorted(names)
    return {
        "digests": {name: digest(name) for name in ordered},
        "training": {name: asdict(training_places(name)) for name in ordered},
    }


@cache
def _commit() -> str:
    """Return the commit that the sources are of, and whether they were changed since; empty without a repository."""
    folder = Path(coopsim.__file__).parent

    def git(*words: str) -> str:
        told = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=20, check=True
        )
        return told.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # a repository around an installation is another's
        changed = bool(git("status", "--porcelain", "--untracked-files=no", "--", "."))
        return git("rev-parse", "HEAD") + ", changed since" * changed
    except (OSError, subprocess.SubprocessError):
        return ""


@dataclass(frozen=True, slots=True)
class TrainingPlaces:
    """The places of a training, and of those before it, by the cards beside the weights.

    Attributes:
        known: cards say how the weights, and all that they were made from, were made.
        scenarios: names and paths of the scenarios, besides towns.
        towns: seeds of the first and the last town of each range of them.
    """

    known: bool = False
    scenarios: tuple[str, ...] = ()
    towns: tuple[tuple[int, int], ...] = ()

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> TrainingPlaces:
        """Return the places as JSON has them, in provenance."""
        towns = tuple((int(first), int(last)) for first, last in data.get("towns", ()))
        return cls(bool(data.get("known")), tuple(data.get("scenarios", ())), towns)

    @property
    def simulated(self) -> bool:
        """True for a training in places of the simulator, False for one on recordings."""
        return bool(self.scenarios or self.towns)

    @property
    def text(self) -> str:
        """The places in words."""
        if not self.known:
            return "places unknown: there is no card beside the weights, or beside those that they were made from"
        towns = [f"towns {first} to {last}" for first, last in self.towns]
        return "trained " + (f"in {', '.join([*towns, *self.scenarios])}" if self.simulated else "on recordings")

    def include(self, scenario: str, place_seed: int | None) -> bool:
        """Return whether a place may be among them; a drawn town is known by its seed alone."""
        if place_seed is not None:
            return any(first <= place_seed <= last for first, last in self.towns)
        return scenario in self.scenarios


def training_places(name_or_path: str) -> TrainingPlaces:
    """Return the places that the cards of weights, and of weights that these were made from, name."""
    found = [_own_places(name) for name in _made_from(name_or_path, set())]
    scenarios = {name: None for each in found for name in each.scenarios}
    towns = {range_: None for each in found for range_ in each.towns}
    return TrainingPlaces(all(each.known for each in found), tuple(scenarios), tuple(towns))


_OF_RECORDINGS = ("covariance",)
_ALONE = ("detector", "point_identity", "picture_identity", *_OF_RECORDINGS)
"""Kinds of training that stand on no detector."""


def _made_from(name: str, known: set[str]) -> Iterator[str]:
    """Yield the name of weights, and those of weights that they began with, stand on, or were taught by."""
    if name in known:
        return
    known.add(name)
    yield name
    recipe = _recipe(name)
    kind = recipe.get("kind", "detector")
    before = [recipe.get("start"), *([] if kind in _ALONE else [recipe.get("detector", "pillars")])]
    before += [] if kind == "point_identity" else [recipe.get("teacher")]  # that one's teacher is a folder of CLIP
    for other in filter(None, before):
        yield from _made_from(str(other), known)


def _recipe(name: str) -> dict[str, Any]:
    """Return the recipe of a card; empty: there is none, or the weights that others were made from are gone."""
    # What trains is loaded only where there are weights: it needs torch.
    from coopsim.learn.weights import card

    try:
        return dict(card(name).get("recipe", {}))
    except UnknownNameError:
        return {}


def _own_places(name: str) -> TrainingPlaces:
    """Return the places that the card of weights names itself."""
    from coopsim.learn.clips.world_recipe import WorldRecipe
    from coopsim.world.drawn_places import TOWN

    recipe = _recipe(name)
    if not recipe or recipe.get("kind") in _OF_RECORDINGS:
        return TrainingPlaces(known=bool(recipe))
    world = load(WorldRecipe, recipe.get("world", {}), "world")
    assert isinstance(world, WorldRecipe)
    others = tuple(str(each) for each in world.environments if each != TOWN)
    towns = ((world.first_place, world.first_place + world.places - 1),) if TOWN in world.environments else ()
    return TrainingPlaces(True, others, towns)
