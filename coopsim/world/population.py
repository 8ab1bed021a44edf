"""The numbers of vehicles, people and agents in a scenario."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from coopsim.errors import CrowdedWarning, InvalidValueError
from coopsim.support.checks import require_count, require_probability
from coopsim.types.taxonomy import ObjectClass

_OVERRIDES = {"connected_cars": "penetration", "truck_share": "trucks"}
"""Numbers, and the number that overrides each."""


@dataclass(frozen=True, slots=True)
class Population:
    """Numbers of vehicles, people and agents.

    Attributes:
        vehicles: cars and trucks together, connected ones included.
        truck_share: share of trucks among these, in [0, 1].
        pedestrians: adults on foot.
        connected_cars: cars that are agents.
        rsus: roadside units.
        vans: in addition to `vehicles`, as all that follow.
        buses: on the roads.
        motorcycles: on the roads.
        bicycles: on the edge of lanes or with pedestrians, as the place has it.
        scooters: in the same places.
        children: on foot.
        drones: agents in the air with sensors that look down.
        parked: vehicles at the kerb, where the place has bays.
        penetration: share of the cars that are agents, in [0, 1]; overrides `connected_cars`.
        trucks: number of trucks among the vehicles; overrides `truck_share`.
    """

    vehicles: int = 30
    truck_share: float = 0.15
    pedestrians: int = 8
    connected_cars: int = 3
    rsus: int = 1
    vans: int = 0
    buses: int = 0
    motorcycles: int = 0
    bicycles: int = 0
    scooters: int = 0
    children: int = 0
    drones: int = 0
    parked: int = 0
    penetration: float | None = None
    trucks: int | None = None

    def __post_init__(self) -> None:
        shares = ("truck_share", "penetration")
        counts = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in shares}
        if self.trucks is None:
            del counts["trucks"]
        require_count(0, **counts)
        require_probability(truck_share=self.truck_share)
        if self.cars < 0:
            raise InvalidValueError(f"trucks must be at most vehicles, which is {self.vehicles}, got {self.trucks}")
        if self.penetration is not None:
            require_probability(penetration=self.penetration)
        elif self.connected_cars > self.cars:
            raise InvalidValueError(
                f"connected_cars must be at most the number of cars, which is {self.cars} "
                f"({self.vehicles} vehicles less {self.vehicles - self.cars} trucks), got {self.connected_cars}"
            )
        if self.connected + self.rsus + self.drones == 0:
            raise InvalidValueError("there must be at least one agent: connected_cars + rsus + drones >= 1, got 0")

    @property
    def cars(self) -> int:
        """The number of cars among the vehicles."""
        return _cars_of(self.vehicles, self.truck_share, self.trucks)

    @property
    def connected(self) -> int:
        """The number of cars that are agents."""
        return self.connected_cars if self.penetration is None else round(self.penetration * self.cars)

    @property
    def on_roads(self) -> Mapping[ObjectClass, int]:
        """Numbers of vehicles by class."""
        return {
            ObjectClass.CAR: self.cars,
            ObjectClass.TRUCK: self.vehicles - self.cars,
            ObjectClass.VAN: self.vans,
            ObjectClass.BUS: self.buses,
            ObjectClass.MOTORCYCLE: self.motorcycles,
        }

    @property
    def people(self) -> Mapping[ObjectClass, int]:
        """Numbers of people on foot and on two wheels by class."""
        return {
            ObjectClass.PEDESTRIAN: self.pedestrians,
            ObjectClass.CHILD: self.children,
            ObjectClass.BICYCLE: self.bicycles,
            ObjectClass.SCOOTER: self.scooters,
        }

    @property
    def numbers(self) -> dict[str, Any]:
        """Arguments of `make_scenario` for the same population: all fields except overridden ones."""
        overridden = [name for name, other in _OVERRIDES.items() if getattr(self, other) is not None]
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in overridden}

    def within(self, capacity: int, *names: str, quietly: bool = False) -> Population:
        """Return the population with the numbers called `names` reduced to a total of `capacity`, the first ones first.

        Warns:
            CrowdedWarning: some do not fit; not if `quietly`.
        """
        numbers = {name: getattr(self, name) for name in names}
        excess = asked = sum(numbers.values())
        excess -= capacity
        if excess <= 0:
            return self
        for name, number in numbers.items():
            numbers[name] = number - min(number, excess)
            excess -= number - numbers[name]
        vehicles = numbers.get("vehicles", self.vehicles)
        trucks = None if self.trucks is None else min(self.trucks, vehicles)
        cars = _cars_of(vehicles, self.truck_share, trucks)
        fitting = replace(self, **numbers, trucks=trucks, connected_cars=min(self.connected_cars, cars))
        if not quietly:
            there = ", ".join(f"{name}={number}" for name, number in numbers.items())
            message = f"there is room for {capacity} of {asked} ({' + '.join(names)}), so there are {there}"
            if fitting.connected < self.connected:
                message += f"; only {fitting.connected} of {self.connected} connected cars are there"
            warnings.warn(message, CrowdedWarning, stacklevel=_level_of_caller())
        return fitting


def require_one_of_each(numbers: Mapping[str, Any]) -> None:
    """Raise an InvalidValueError for a number together with the one that overrides it."""
    for number, other in _OVERRIDES.items():
        if number in numbers and numbers.get(other) is not None:
            raise InvalidValueError(f"{other} takes the place of {number}: one of them is accepted, got both")


def drop_overridden(numbers: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a file that still count next to `overrides`, which go before them."""
    pairs = [pair for number, other in _OVERRIDES.items() for pair in ((number, other), (other, number))]
    overridden = {number for number, other in pairs if overrides.get(other) is not None}
    return {name: value for name, value in numbers.items() if name not in overridden}


def _level_of_caller() -> int:
    """Return the `stacklevel` for `warnings.warn` of the first caller outside coopsim."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals["__name__"].partition(".")[0] == "coopsim":
        frame, level = frame.f_back, level + 1
    return level


def _cars_of(vehicles: int, truck_share: float, trucks: int | None) -> int:
    return vehicles - (round(truck_share * vehicles) if trucks is None else trucks)
