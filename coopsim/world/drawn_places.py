"""Scenarios of episodes by name: of one place, or of places that are drawn, with the same agents in all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.scenario import SCENARIOS, EpisodeScenarios, Place, SameScenario, make_scenario

TOWN = "town"
"""Name of the scenario of drawn towns."""

_OF_TOWNS: tuple[type[Any], ...] = (PlaceSeeds, TownOptions)

TOWN_KEYS = tuple(field.name for kind in _OF_TOWNS for field in fields(kind))
"""Options of towns, besides those of all scenarios."""


class DrawnPlaces(ABC):
    """Drawer of places."""

    @abstractmethod
    def place(self, place_seed: int, options: TownOptions) -> Place:
        """Draw a place."""

    @abstractmethod
    def scenarios(
        self, seeds: PlaceSeeds, options: TownOptions, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> EpisodeScenarios:
        """Return the scenarios of episodes in drawn places.

        Args:
            seeds: seeds of the places.
            options: options of the places.
            density: factor on the numbers of vehicles and people, but not of agents.
            detail: one of `coopsim.world.scenario.DETAILS`; None is "full".
            numbers: fields of `Population` that are asked for.

        Raises:
            UnknownNameError: there is no such number or detail.
            InvalidValueError: a number is not accepted, or not every place has space for that many agents.
        """


DRAWN: Registry[type[DrawnPlaces]] = Registry("drawn place", home="coopsim.world.towns.scenarios")
"""Drawers of places, by the names of their scenarios."""


def choose_scenarios(
    place: str | Place, *, density: float = 1.0, detail: str | None = None, **options: Any
) -> EpisodeScenarios:
    """Return the scenarios of an environment's episodes.

    Args:
        place: name of a scenario, "town" among them, or a custom place.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `coopsim.world.scenario.DETAILS`; None: the usual one of the place.
        **options: fields of `Population`, and of `PlaceSeeds` and `TownOptions` for towns.

    Raises:
        CoopsimError: see `make_scenario` and `DrawnPlaces`.
    """
    if not isinstance(place, Place):
        require_choice("scenario", place, scenario_names())
    if isinstance(place, Place) or place not in DRAWN:
        return SameScenario(make_scenario(place, density=density, detail=detail, **options))
    seeds, town = ({f.name: options.pop(f.name) for f in fields(kind) if f.name in options} for kind in _OF_TOWNS)
    return DRAWN.get(place)().scenarios(PlaceSeeds(**seeds), TownOptions(**town), density, detail, options)


def scenario_names() -> list[str]:
    """Return the names of all scenarios, drawn ones last."""
    return [*SCENARIOS, *DRAWN]
