"""Scenarios of episodes by name: of one place, or of places that are drawn, with the same agents in all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.scenario import SCENARIOS, EpisodeScenarios, Place, SameScenario, make_scenario
from coopsim.world.traffic.traffic import ENGINES

TOWN = "town"
"""Name of the scenario of drawn towns."""

_OF_TOWNS: tuple[type[Any], ...] = (PlaceSeeds, TownOptions)

TOWN_KEYS = tuple(field.name for kind in _OF_TOWNS for field in fields(kind))
"""Options of towns, besides those of all scenarios."""


class DrawnPlaces(ABC):
    """Drawer of places.

    Attributes:
        kinds: `PlaceSeeds`, and the class of the options of its places.
    """

    kinds: ClassVar[tuple[type[Any], type[Any]]] = (PlaceSeeds, TownOptions)

    @abstractmethod
    def place(self, place_seed: int, options: Any) -> Place:
        """Draw a place."""

    @abstractmethod
    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
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

PLACE_FILES: Registry[Callable[[str], DrawnPlaces]] = Registry(
    "file of places", home=("coopsim.data.maps.place.scenarios", "coopsim.data.logs.play.scenarios")
)
"""Makers of drawers of places from the path of a file, by how its name ends, before ".gz" and in small letters."""

LIVE_TRAFFIC: Registry[Callable[[object, float], DrawnPlaces]] = Registry(
    "live traffic", home="coopsim.data.live.scenarios"
)
"""Makers of drawers of places in which another program drives, from a scenario and the time between frames, s."""


def is_live(traffic: object) -> bool:
    """Return whether another program drives, by the option `traffic`."""
    return isinstance(traffic, str) and traffic not in ENGINES and traffic in LIVE_TRAFFIC


def is_place_file(scenario: object) -> bool:
    """Return whether a scenario is the path of a file that places are drawn from, by its name."""
    if not isinstance(scenario, (str, Path)) or "." not in str(scenario):
        return False
    return str(scenario).lower().removesuffix(".gz").endswith(PLACE_FILES.names())


def find_drawer(scenario: object) -> DrawnPlaces | None:
    """Return what draws the places of a scenario; None: it is one place."""
    if is_place_file(scenario):
        path = str(scenario)
        (end,) = (end for end in PLACE_FILES if path.lower().removesuffix(".gz").endswith(end))
        return PLACE_FILES.get(end)(path)
    return DRAWN.get(scenario)() if isinstance(scenario, str) and scenario in DRAWN else None


def choose_scenarios(
    place: str | Place,
    *,
    density: float = 1.0,
    detail: str | None = None,
    drawer: DrawnPlaces | None = None,
    **options: Any,
) -> EpisodeScenarios:
    """Return the scenarios of an environment's episodes.

    Args:
        place: name of a scenario, "town" among them, path of a file of places, or a custom place.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `coopsim.world.scenario.DETAILS`; None: the usual one of the place.
        drawer: drawer of its places; None: found by the place.
        **options: fields of `Population`, and those of `DrawnPlaces.kinds` for drawn places.

    Raises:
        CoopsimError: see `make_scenario` and `DrawnPlaces`.
    """
    drawer = find_drawer(place) if drawer is None else drawer
    if drawer is None:
        if not isinstance(place, Place):
            require_choice("scenario", place, scenario_names())
        return SameScenario(make_scenario(place, density=density, detail=detail, **options))
    seeds, own = (
        kind(**{f.name: options.pop(f.name) for f in fields(kind) if f.name in options}) for kind in drawer.kinds
    )
    return drawer.scenarios(seeds, own, density, detail, options)


def scenario_names() -> list[str]:
    """Return the names of all scenarios, drawn ones last."""
    return [*SCENARIOS, *DRAWN]
