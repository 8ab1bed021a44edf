"""Scenarios of drawn towns, with the same agents in all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.world.custom.place import write_place_file
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.drawn_places import DRAWN, TOWN, TOWN_KEYS, DrawnPlaces
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import (
    MOST_BYSTANDERS,
    NUMBERS,
    EpisodeScenarios,
    Place,
    Scenario,
    rooms,
    wanted_numbers,
)
from coopsim.world.surroundings.street import street_for
from coopsim.world.towns.town import FEWEST, FEWEST_STARTS, MOST, MOST_TOGETHER, MOVING, draw_place


class TownScenarios(EpisodeScenarios):
    """Scenarios of drawn towns.

    Numbers that are not asked for are those that are usual in each place, and never more than fit there.

    Args:
        seeds: seeds of the places.
        options: options of the places.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `coopsim.world.scenario.DETAILS`; None is "full".
        numbers: fields of `Population` that are asked for.

    Raises:
        UnknownNameError: there is no such number or detail.
        InvalidValueError: a number is not accepted, or not every town has space for that many agents.
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
        if self._detail == "street":
            self._asked.setdefault("parked", 0)  # vehicles in bays are bystanders then
        self._agents = self._constant_agents()
        most = Population(**self._wanted(MOST))
        self.most_actors = sum(min(room, sum(getattr(most, name) for name in names)) for names, room in MOST_TOGETHER)
        self.most_actors += MOST_BYSTANDERS if self._detail == "street" else 0
        self._drawn(0)

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the place that belongs to the episode with this seed."""
        place, layout, population = self._drawn(seed)
        if self._detail == "street":
            assert place.description is not None, "it was built from one"
            layout = street_for(place.description.identity, layout, park=not population.parked)
        return Scenario(TOWN, layout, population, self._detail, place.description, self._seeds.of(seed))

    def _drawn(self, seed: int) -> tuple[Place, Layout, Population]:
        """Return the place of an episode, its layout, and the population that fits there."""
        place = draw_place(self._seeds.of(seed), self._options)
        layout = place.make_layout()
        return place, layout, self._fitting(Population(**self._wanted(_at_most(place.population, MOST))), layout)

    def _wanted(self, usual: Population) -> dict[str, Any]:
        """Return the fields of the population of a place with this usual one."""
        return wanted_numbers(TOWN, usual, self._density, self._asked) | self._agents

    def _constant_agents(self) -> dict[str, Any]:
        """Return the fields that decide the agents, which are the same in all places."""
        asked = self._asked
        for name in ("rsus", "drones"):
            _require_places(name, asked.get(name, 0), getattr(FEWEST, name), "places for them")
        agents = {"rsus": asked.get("rsus", FEWEST.rsus), "drones": asked.get("drones", 0)}
        fewest = wanted_numbers(TOWN, FEWEST, self._density, asked) | {"connected_cars": 0, "rsus": 1}
        everybody = self._reduced(Population(**fewest), FEWEST_STARTS, MOVING)
        cars = everybody.within(FEWEST_STARTS, *MOVING, quietly=True).cars
        if asked.get("penetration") is None:
            _require_places("connected_cars", asked.get("connected_cars", 0), cars, "cars")
            return agents | {"connected_cars": asked.get("connected_cars", min(FEWEST.connected_cars, cars))}
        if "vehicles" not in asked:
            raise InvalidValueError(
                f"penetration needs vehicles in {TOWN!r}: their number differs from town to town, and the agents must "
                "be the same in all; or use connected_cars"
            )
        _require_places("connected_cars", everybody.connected, cars, "cars")
        return agents | {"connected_cars": everybody.connected, "penetration": None}

    def _fitting(self, population: Population, layout: Layout) -> Population:
        """Reduce numbers that are too large for a place: those not asked for quietly, and first."""
        for room, names in rooms(layout):
            names = MOVING if "vehicles" in names else names
            population = self._reduced(population, room, names).within(room, *names)
        for names, most in MOST_TOGETHER:
            population = population.within(most, *names)
        return population

    def _reduced(self, population: Population, room: int, names: Sequence[str]) -> Population:
        """Reduce the numbers among `names` that were not asked for until all of them fit, if they can."""
        asked = sum(getattr(population, name) for name in names if name in self._asked)
        unasked = [name for name in names if name not in self._asked]
        return population.within(max(0, room - asked), *unasked, quietly=True)


def _at_most(usual: Population, most: Population) -> Population:
    """Return the usual population of a place with no number of vehicles or people above the largest that is usual."""
    counted = [name for names, _ in MOST_TOGETHER for name in names]
    return replace(usual, **{name: min(getattr(usual, name), getattr(most, name)) for name in counted})


def _require_places(name: str, number: object, most: int, places: str) -> None:
    """Refuse more agents than every town has places for; `Population` refuses a value that is no number."""
    if isinstance(number, Integral) and int(number) > most:
        raise InvalidValueError(
            f"{name} must be at most {most} in {TOWN!r}, got {number}: all towns have the same agents, and the "
            f"smallest has no more {places}"
        )


@DRAWN.register(TOWN)
class Towns(DrawnPlaces):
    """Drawn towns."""

    def place(self, place_seed: int, options: TownOptions) -> Place:
        return draw_place(place_seed, options)

    def scenarios(
        self, seeds: PlaceSeeds, options: TownOptions, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> TownScenarios:
        return TownScenarios(seeds, options, density, detail, numbers)


def draw_town(place_seed: int, options: TownOptions) -> Scenario:
    """Draw a town with its usual population."""
    return TownScenarios(PlaceSeeds(place_seed), options, 1.0, None, {}).of(place_seed)


def write_town(path: Path, town: Scenario) -> Path:
    """Write a drawn town as a scenario file, whose episodes are those of the drawn one, bit by bit.

    Raises:
        InvalidValueError: it is no drawn town, or the name is not that of a scenario file.
        ScenarioFileError: the file cannot be written.
    """
    if town.description is None:
        raise InvalidValueError(f"town must be a scenario with a description, got {town.name!r}, which has none")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InvalidValueError(f"path of a scenario file must end in .yaml, got {str(path)!r}")
    content = {"population": town.population.numbers, "options": {"detail": town.detail}}
    return write_place_file(path, town.description, content)
