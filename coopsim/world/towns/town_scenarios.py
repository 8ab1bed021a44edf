"""Drawn towns as scenarios: for each episode a place with its population, and the same agents in all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from numbers import Integral
from typing import Any

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import NUMBERS, EpisodeScenarios, Scenario, rooms, wanted_numbers
from coopsim.world.towns.drawn_place import draw_place
from coopsim.world.towns.place_seeds import PlaceSeeds
from coopsim.world.towns.streets.town_options import TownOptions
from coopsim.world.towns.town_population import FEWEST, FEWEST_STARTS, MOST, MOST_TOGETHER, MOVING

TOWN = "town"
"""Name of the scenario."""

TOWN_KEYS = tuple(field.name for kind in (PlaceSeeds, TownOptions) for field in fields(kind))
"""Options of towns, besides those of all scenarios."""


class TownScenarios(EpisodeScenarios):
    """The scenarios of drawn towns.

    Numbers that are not asked for are those that are usual in each place, and never more than fit there.

    Args:
        seeds: of the places.
        options: how the places are.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `coopsim.world.scenario.DETAILS`; None is "full".
        numbers: fields of `Population` that are asked for.

    Raises:
        UnknownNameError: there is no such number or detail.
        InvalidValueError: a number is not accepted, or not every town has room for so many agents.
    """

    def __init__(
        self, seeds: PlaceSeeds, options: TownOptions, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> None:
        for name in numbers:
            if name not in NUMBERS:
                raise UnknownNameError("option of towns", name, (*NUMBERS, "detail", *TOWN_KEYS))
        self.name = TOWN
        self._seeds, self._options, self._density, self._detail = seeds, options, density, detail or "full"
        self._asked = dict(numbers)
        self._agents = self._constant_agents()
        most = Population(**self._wanted(MOST))
        self.most_actors = sum(min(room, sum(getattr(most, name) for name in names)) for names, room in MOST_TOGETHER)
        self.of(0)

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the place that belongs to the episode with this seed."""
        place_seed = self._seeds.of(seed)
        place = draw_place(place_seed, self._options)
        layout = place.make_layout()
        population = self._fitting(Population(**self._wanted(_at_most(place.population, MOST))), layout)
        return Scenario(TOWN, layout, population, self._detail, place.description, place_seed)

    def _wanted(self, usual: Population) -> dict[str, Any]:
        """Return the fields of the population of a place with this usual one."""
        return wanted_numbers(TOWN, usual, self._density, self._asked) | self._agents

    def _constant_agents(self) -> dict[str, Any]:
        """Return the fields that decide the agents, which are the same in all places."""
        asked = self._asked
        for name in ("rsus", "drones"):
            _require_room(name, asked.get(name, 0), getattr(FEWEST, name), "places for them")
        agents = {"rsus": asked.get("rsus", FEWEST.rsus), "drones": asked.get("drones", 0)}
        fewest = wanted_numbers(TOWN, FEWEST, self._density, asked) | {"connected_cars": 0, "rsus": 1}
        everybody = self._reduced(Population(**fewest), FEWEST_STARTS, MOVING)
        cars = everybody.within(FEWEST_STARTS, *MOVING, quietly=True).cars
        if asked.get("penetration") is None:
            _require_room("connected_cars", asked.get("connected_cars", 0), cars, "cars")
            return agents | {"connected_cars": asked.get("connected_cars", min(FEWEST.connected_cars, cars))}
        if "vehicles" not in asked:
            raise InvalidValueError(
                f"penetration needs vehicles in {TOWN!r}: their number differs from town to town, and the agents must "
                "be the same in all; or use connected_cars"
            )
        _require_room("connected_cars", everybody.connected, cars, "cars")
        return agents | {"connected_cars": everybody.connected, "penetration": None}

    def _fitting(self, population: Population, layout: Layout) -> Population:
        """Reduce what is too much for a place: what was not asked for quietly, and first."""
        for room, names in rooms(layout):
            names = MOVING if "vehicles" in names else names
            population = self._reduced(population, room, names).within(room, *names)
        for names, most in MOST_TOGETHER:
            population = population.within(most, *names)
        return population

    def _reduced(self, population: Population, room: int, names: Sequence[str]) -> Population:
        """Reduce those of the numbers called `names` that were not asked for until all of them fit, if they can."""
        asked = sum(getattr(population, name) for name in names if name in self._asked)
        unasked = [name for name in names if name not in self._asked]
        return population.within(max(0, room - asked), *unasked, quietly=True)


def _at_most(usual: Population, most: Population) -> Population:
    """Return the usual population of a place with no number of vehicles or people above the largest that is usual."""
    counted = [name for names, _ in MOST_TOGETHER for name in names]
    return replace(usual, **{name: min(getattr(usual, name), getattr(most, name)) for name in counted})


def _require_room(name: str, number: object, most: int, room: str) -> None:
    """Refuse more agents than every town has `room` for; `Population` refuses what is no number."""
    if isinstance(number, Integral) and int(number) > most:
        raise InvalidValueError(
            f"{name} must be at most {most} in {TOWN!r}, got {number}: all towns have the same agents, and the "
            f"smallest has no more {room}"
        )
