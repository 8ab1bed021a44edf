"""Scenarios: a place, and how many of what are in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from coopsim.checks import require_count, require_probability
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.registry import Registry
from coopsim.world.crossing import make_crossing
from coopsim.world.highway import make_highway
from coopsim.world.layout import Layout


@dataclass(frozen=True, slots=True)
class Population:
    """How many of what there are.

    Attributes:
        vehicles: cars and trucks together, connected ones included.
        truck_share: of the vehicles, in [0, 1].
        pedestrians: people on foot.
        connected_cars: how many of the cars are connected agents.
        rsus: roadside units.
    """

    vehicles: int = 30
    truck_share: float = 0.15
    pedestrians: int = 8
    connected_cars: int = 3
    rsus: int = 1

    def __post_init__(self) -> None:
        require_count(
            0,
            vehicles=self.vehicles,
            pedestrians=self.pedestrians,
            connected_cars=self.connected_cars,
            rsus=self.rsus,
        )
        require_probability(truck_share=self.truck_share)
        if self.connected_cars > self.vehicles - self.trucks:
            raise InvalidValueError(
                f"connected_cars must be at most the number of cars, which is {self.vehicles - self.trucks} "
                f"({self.vehicles} vehicles less {self.trucks} trucks), got {self.connected_cars}"
            )
        if self.connected_cars + self.rsus == 0:
            raise InvalidValueError("there must be at least one agent: connected_cars + rsus >= 1, got 0")

    @property
    def trucks(self) -> int:
        """How many of the vehicles are trucks."""
        return round(self.truck_share * self.vehicles)


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A place with its population.

    Attributes:
        name: as it is registered.
        layout: the place.
        population: who is there.
    """

    name: str
    layout: Layout
    population: Population

    def __post_init__(self) -> None:
        room = {
            "vehicles": len(self.layout.slots),
            "rsus": len(self.layout.rsus),
            "pedestrians": self.layout.footways.room if self.layout.footways is not None else 0,
        }
        for name, most in room.items():
            if getattr(self.population, name) > most:
                raise InvalidValueError(
                    f"{name} must be at most {most} in {self.name!r}, got {getattr(self.population, name)}"
                )


@dataclass(frozen=True, slots=True)
class _Recipe:
    make_layout: Callable[[], Layout]
    population: Population


SCENARIOS: Registry[_Recipe] = Registry("scenario")
SCENARIOS.register("crossing")(_Recipe(make_crossing, Population()))
SCENARIOS.register("highway")(_Recipe(make_highway, Population(pedestrians=0)))


def make_scenario(name: str, **numbers: Any) -> Scenario:
    """The scenario called `name`, with its own population except for `numbers` (fields of `Population`).

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a number that is not accepted, or more than there is room for.
    """
    recipe = SCENARIOS.get(name)
    known = [field.name for field in fields(Population)]
    for number in numbers:
        if number not in known:
            raise UnknownNameError(f"number of scenario {name!r}", number, known)
    usual = {field: getattr(recipe.population, field) for field in known}
    return Scenario(name, recipe.make_layout(), Population(**(usual | numbers)))
