"""Scenarios: a place, and how many of what are in it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from coopsim.checks import require_count, require_non_negative, require_probability
from coopsim.errors import CrowdedWarning, InvalidValueError, UnknownNameError
from coopsim.registry import Registry
from coopsim.taxonomy import ObjectClass
from coopsim.world.crossing import make_crossing, make_t_junction
from coopsim.world.grid import make_urban_grid
from coopsim.world.highway import make_highway, make_platoon
from coopsim.world.layout import Layout
from coopsim.world.merge import make_merge
from coopsim.world.roundabout import make_roundabout
from coopsim.world.street import make_occluded_crossing, make_parking_street


@dataclass(frozen=True, slots=True)
class Population:
    """How many of what there are.

    Attributes:
        vehicles: cars and trucks together, connected ones included.
        truck_share: of these, in [0, 1].
        pedestrians: people on foot.
        connected_cars: how many of the cars are connected agents.
        rsus: roadside units.
        vans: next to `vehicles`, as all that follow.
        buses: on the roads.
        motorcycles: on the roads.
        bicycles: where the place has room for them: on the edge of lanes, or with pedestrians.
        scooters: as bicycles.
        children: on foot.
        drones: agents in the air, each with sensors that look down.
        parked: vehicles at the kerb, where the place has bays.
        penetration: share of the cars that are connected, in [0, 1], in the place of `connected_cars`.
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

    def __post_init__(self) -> None:
        counts = [field.name for field in fields(self) if field.name not in ("truck_share", "penetration")]
        require_count(0, **{name: getattr(self, name) for name in counts})
        require_probability(truck_share=self.truck_share)
        if self.penetration is not None:
            require_probability(penetration=self.penetration)
        elif self.connected_cars > self.cars:
            raise InvalidValueError(
                f"connected_cars must be at most the number of cars, which is {self.cars} "
                f"({self.vehicles} vehicles less {self.trucks} trucks), got {self.connected_cars}"
            )
        if self.connected + self.rsus + self.drones == 0:
            raise InvalidValueError("there must be at least one agent: connected_cars + rsus + drones >= 1, got 0")

    @property
    def trucks(self) -> int:
        """How many of the vehicles are trucks."""
        return round(self.truck_share * self.vehicles)

    @property
    def cars(self) -> int:
        """How many of the vehicles are cars."""
        return self.vehicles - self.trucks

    @property
    def connected(self) -> int:
        """How many of the cars are connected agents."""
        return self.connected_cars if self.penetration is None else round(self.penetration * self.cars)

    @property
    def on_roads(self) -> Mapping[ObjectClass, int]:
        """Vehicles by class."""
        return {
            ObjectClass.CAR: self.cars,
            ObjectClass.TRUCK: self.trucks,
            ObjectClass.VAN: self.vans,
            ObjectClass.BUS: self.buses,
            ObjectClass.MOTORCYCLE: self.motorcycles,
        }

    @property
    def people(self) -> Mapping[ObjectClass, int]:
        """People on foot and on two wheels by class."""
        return {
            ObjectClass.PEDESTRIAN: self.pedestrians,
            ObjectClass.CHILD: self.children,
            ObjectClass.BICYCLE: self.bicycles,
            ObjectClass.SCOOTER: self.scooters,
        }

    def within(self, room: int, *names: str) -> Population:
        """As many of the numbers called `names` as there is room for, together; the first give way first.

        Warns:
            CrowdedWarning: that they do not all fit.
        """
        numbers = {name: getattr(self, name) for name in names}
        excess = asked = sum(numbers.values())
        excess -= room
        if excess <= 0:
            return self
        for name, number in numbers.items():
            numbers[name] = number - min(number, excess)
            excess -= number - numbers[name]
        fitting = ", ".join(f"{name}={number}" for name, number in numbers.items())
        message = f"there is room for {room} of {asked} ({' + '.join(names)}), so there are {fitting}"
        warnings.warn(message, CrowdedWarning, stacklevel=5)  # the caller of `make_scenario`
        cars = numbers.get("vehicles", self.vehicles)
        cars -= round(self.truck_share * cars)
        return replace(self, **numbers, connected_cars=min(self.connected_cars, cars))


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A place with its population.

    Attributes:
        name: as it is registered.
        layout: the place.
        population: who is there: as asked for, as far as there is room.

    Warns:
        CrowdedWarning: there is not room for all.
    """

    name: str
    layout: Layout
    population: Population

    def __post_init__(self) -> None:
        feet, wheels = ("pedestrians", "children"), ("bicycles", "scooters")
        ways, cycleways = self.layout.footways, self.layout.cycleways
        self._require_at_most(len(self.layout.rsus), "rsus")
        self._require_at_most(len(self.layout.flights), "drones")
        if not self.layout.bays:
            self._require_at_most(0, "parked")
        if ways is None:
            self._require_at_most(0, *feet)
        if ways is None and cycleways is None:
            self._require_at_most(0, *wheels)
        fitting = self.population.within(len(self.layout.slots), "vehicles", "vans", "buses", "motorcycles")
        fitting = fitting.within(len(self.layout.bays), "parked")
        if ways is not None:
            fitting = fitting.within(ways.room, *feet, *(() if cycleways else wheels))
        if cycleways is not None:
            fitting = fitting.within(cycleways.room, *wheels)
        object.__setattr__(self, "population", fitting)

    def _require_at_most(self, most: int, *names: str) -> None:
        for name in names:
            if getattr(self.population, name) > most:
                raise InvalidValueError(
                    f"{name} must be at most {most} in {self.name!r}, got {getattr(self.population, name)}"
                )


_DENSE = (
    "vehicles",
    "vans",
    "buses",
    "motorcycles",
    "parked",
    "pedestrians",
    "children",
    "bicycles",
    "scooters",
)


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a scenario is, and who is there unless one says otherwise.

    Attributes:
        name: of the scenario.
        make_layout: builds the layout.
        population: its own numbers.
    """

    name: str
    make_layout: Callable[[], Layout]
    population: Population


SCENARIOS: Registry[Place] = Registry("scenario")


def _register(name: str, make_layout: Callable[[], Layout], population: Population) -> None:
    SCENARIOS.register(name)(Place(name, make_layout, population))


_register("crossing", make_crossing, Population())
_register("t_junction", make_t_junction, Population(vehicles=18))
_STREET = Population(vehicles=14, truck_share=0.1, connected_cars=2)
_register("parking_street", make_parking_street, replace(_STREET, pedestrians=16, parked=40))
_register("occluded_crossing", make_occluded_crossing, replace(_STREET, parked=12))
_register("roundabout", make_roundabout, Population(vehicles=24))
_register("merge", make_merge, Population(vehicles=24, pedestrians=0))
_register("urban_grid", make_urban_grid, Population(vehicles=40, pedestrians=20, rsus=2))
_register("highway", make_highway, Population(pedestrians=0))
_register("platoon", make_platoon, Population(pedestrians=0, connected_cars=4, rsus=0))


def make_scenario(place: str | Place, *, density: float = 1.0, **numbers: Any) -> Scenario:
    """A scenario with its own population except for `numbers` (fields of `Population`).

    Args:
        place: its name as it is registered, or a place of one's own.
        density: a factor on the numbers of vehicles and people, of all that are not agents.
        **numbers: fields of `Population`.

    Raises:
        UnknownNameError: no such scenario or number.
        InvalidValueError: a number that is not accepted.

    Warns:
        CrowdedWarning: there is not room for all; as many as fit are there.
    """
    found = place if isinstance(place, Place) else SCENARIOS.get(place)
    known = [field.name for field in fields(Population)]
    for number in numbers:
        if number not in known:
            raise UnknownNameError(f"number of scenario {found.name!r}", number, known)
    usual = {field: getattr(found.population, field) for field in known}
    require_non_negative(density=density)
    wanted = usual | numbers
    dense = {field: round(density * wanted[field]) if _is_count(wanted[field]) else wanted[field] for field in _DENSE}
    return Scenario(found.name, found.make_layout(), Population(**(wanted | dense)))


def _is_count(value: object) -> bool:
    """What is none is refused by `Population`, in the user's words."""
    return isinstance(value, int) and not isinstance(value, bool)
