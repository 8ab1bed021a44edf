"""Scenarios of episodes by name: of one place, or of drawn towns."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from coopsim.support.checks import require_choice
from coopsim.world.scenario import SCENARIOS, EpisodeScenarios, Place, SameScenario, make_scenario
from coopsim.world.towns.place_seeds import PlaceSeeds
from coopsim.world.towns.streets.town_options import TownOptions
from coopsim.world.towns.town_scenarios import TOWN, TownScenarios

_OF_TOWNS: tuple[type[Any], ...] = (PlaceSeeds, TownOptions)


def choose_scenarios(
    place: str | Place, *, density: float = 1.0, detail: str | None = None, **options: Any
) -> EpisodeScenarios:
    """Return the scenarios of an environment's episodes.

    Args:
        place: name of a scenario, "town" among them, or a custom place.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `coopsim.world.scenario.DETAILS`; None: what is usual in the place.
        **options: fields of `Population`, and of `PlaceSeeds` and `TownOptions` for towns.

    Raises:
        CoopsimError: as `make_scenario` and `TownScenarios` do.
    """
    if not isinstance(place, Place):
        require_choice("scenario", place, scenario_names())
    if place != TOWN:
        return SameScenario(make_scenario(place, density=density, detail=detail, **options))
    seeds, town = ({f.name: options.pop(f.name) for f in fields(kind) if f.name in options} for kind in _OF_TOWNS)
    return TownScenarios(PlaceSeeds(**seeds), TownOptions(**town), density, detail, options)


def scenario_names() -> list[str]:
    """Return the names of all scenarios, towns last."""
    return [*SCENARIOS, TOWN]
