"""Where networks were trained, by the cards beside their weights and those of weights that these were made from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from coopsim.config.load import load
from coopsim.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class TrainingPlaces:
    """The places of a training, and of those before it.

    Attributes:
        known: whether cards say how the weights, and all that they were made from, were made.
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
        """Whether the training was in places of the simulator, and not on recordings."""
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
    """Return the places that the cards of weights, and of weights that these were made from, name.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: a card is broken, or names what no recipe has.
    """
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
    from coopsim.world.towns.scenarios import TOWN

    recipe = _recipe(name)
    if not recipe or recipe.get("kind") in _OF_RECORDINGS:
        return TrainingPlaces(known=bool(recipe))
    world = load(WorldRecipe, recipe.get("world", {}), "world")
    assert isinstance(world, WorldRecipe)
    others = tuple(str(each) for each in world.environments if each != TOWN)
    towns = ((world.first_place, world.first_place + world.places - 1),) if TOWN in world.environments else ()
    return TrainingPlaces(True, others, towns)
