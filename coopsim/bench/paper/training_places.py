"""Where networks were trained, by the cards beside their weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from coopsim.config.load import load


@dataclass(frozen=True, slots=True)
class TrainingPlaces:
    """The places of a training.

    Attributes:
        known: whether a card says how the weights were made.
        scenarios: names and paths of the scenarios, besides towns.
        first_town: seed of the first town.
        last_town: seed of the last one; below the first if the training was in no town.
    """

    known: bool = False
    scenarios: tuple[str, ...] = ()
    first_town: int = 0
    last_town: int = -1

    @property
    def simulated(self) -> bool:
        """Whether the training was in places of the simulator, and not on recordings."""
        return bool(self.scenarios) or self.last_town >= self.first_town

    @property
    def text(self) -> str:
        """The places in words."""
        if not self.known:
            return "places unknown: there is no card beside the weights"
        towns = [f"towns {self.first_town} to {self.last_town}"] * (self.last_town >= self.first_town)
        return "trained " + (f"in {', '.join([*towns, *self.scenarios])}" if self.simulated else "on recordings")

    def include(self, scenario: str, place_seed: int | None) -> bool:
        """Return whether a place may be among them; a drawn town is known by its seed alone."""
        if place_seed is not None:
            return self.first_town <= place_seed <= self.last_town
        return scenario in self.scenarios


def training_places(name_or_path: str) -> TrainingPlaces:
    """Return the places that the card of weights names.

    Raises:
        UnknownNameError: there are no such weights.
        InvalidValueError: the card names what no recipe has.
    """
    # What trains is loaded only where there are weights: it needs torch.
    from coopsim.learn.rollout.world_recipe import WorldRecipe
    from coopsim.learn.weights import card
    from coopsim.world.towns.town_scenarios import TOWN

    recipe: dict[str, Any] = card(name_or_path).get("recipe", {})
    if not recipe:
        return TrainingPlaces()
    if recipe.get("kind") == "covariance":
        return TrainingPlaces(known=True)
    world = load(WorldRecipe, recipe.get("world", {}), "world")
    assert isinstance(world, WorldRecipe)
    others = tuple(str(each) for each in world.environments if each != TOWN)
    last = world.first_place + world.places - 1 if TOWN in world.environments else -1
    return TrainingPlaces(True, others, world.first_place, last)
