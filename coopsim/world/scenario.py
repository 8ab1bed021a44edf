"""Scenarios: a place and its population."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from numbers import Integral
from typing import Any, Protocol

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice, require_non_negative
from coopsim.support.registry import Registry
from coopsim.world.models import Model, make_models
from coopsim.world.places.crossings import (
    make_crossing,
    make_occluded_crossing,
    make_parking_street,
    make_roundabout,
    make_t_junction,
)
from coopsim.world.places.crowns import crowns_of
from coopsim.world.places.description import PlaceDescription
from coopsim.world.places.highway import make_highway, make_platoon
from coopsim.world.places.layout import Layout
from coopsim.world.places.merge import make_merge
from coopsim.world.places.place import BUILDERS
from coopsim.world.places.place import Place as Place
from coopsim.world.places.urban_grid import make_urban_grid
from coopsim.world.population import Population, require_one_of_each
from coopsim.world.script import Script
from coopsim.world.snapshot import RoadMap, StaticPart, WorldSource

DETAILS = ("plain", "full", "street")
"""How much there is to see: roads, buildings and a few shapes of actors; also furniture, plants, varied actors; also
the surroundings of real streets, and people and vehicles at rest in them."""

MOST_BYSTANDERS = 600
"""Most actors at rest in the surroundings of one place; those that come later are left out."""

FURNISHINGS: Registry[Callable[..., Layout]] = Registry("furnishing", home="coopsim.world.surroundings.furnishings")
"""Functions that return a layout with more in it.

"furniture" and what stands and rests in a "street" are given the place's identity (its name, or all of its description
as text), its layout and its population, "clutter" a layout and a random generator.
"""


class Played(Protocol):
    """Traffic that is played, not simulated.

    Attributes:
        over_s: time at which the episode is over.
        facts: facts about it for `infos`, by name.
    """

    @property
    def over_s(self) -> float: ...

    @property
    def facts(self) -> Mapping[str, Any]: ...

    def world(
        self, scenario: Scenario, seed: int, *, control: str = "traffic", driven: Sequence[str] | None = None
    ) -> WorldSource:
        """Return the world of an episode, in the layout of its scenario; see `World` for `control` and `driven`.

        Raises:
            CoopsimError: cars cannot be driven so, or there is no car of a name.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A place with its population.

    Attributes:
        name: registered name.
        layout: the place.
        population: the requested numbers, as far as they fit.
        detail: one of `DETAILS`.
        description: it was built from this; None: the place is built in.
        place_seed: seed that the place was drawn from; None: it was not drawn.
        script: vehicles on the roads, and people beside those of the population, who are not drawn; the population's
            numbers of moving vehicles and of connected cars are the script's. None: all are drawn.
        played: traffic that is played; the population's vehicles are its connected cars. None: it is simulated.
        route_m: bounds of the distance to a goal of steered cars that the place itself has. None: they are asked for.

    Warns:
        CrowdedWarning: some do not fit.
    """

    name: str
    layout: Layout
    population: Population
    detail: str = "plain"
    description: PlaceDescription | None = field(default=None, repr=False)  # of hundreds of lines
    place_seed: int | None = None
    script: Script | None = None
    played: Played | None = None
    route_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        require_choice("detail", self.detail, DETAILS)
        self._require_at_most(len(self.layout.rsus), "rsus")
        self._require_at_most(len(self.layout.flights), "drones")
        fitting = self.population
        for room, names in () if self.played is not None else rooms(self.layout):
            if self.script is not None and "vehicles" in names:
                continue
            if not room and "vehicles" not in names:
                self._require_at_most(0, *names)
            fitting = fitting.within(room, *names)
        object.__setattr__(self, "population", fitting)

    @property
    def static(self) -> tuple[StaticPart, ...]:
        """The meshes that stand there, furnishing in full detail only."""
        return self.layout.static + (self.layout.furnishing if self.detail != "plain" else ())

    @property
    def road_map(self) -> RoadMap:
        """The outlines of the place, with the crowns of the trees that stand there."""
        return replace(self.layout.road_map, trees=crowns_of(self.static))

    @property
    def models(self) -> tuple[Model, ...]:
        """The shapes that actors may have: many more in full detail."""
        return make_models(varied=self.detail != "plain", at_rest=self.detail == "street")

    @property
    def over_s(self) -> float | None:
        """The time at which the situation, or what is played, is over; None: it goes on."""
        source = self.played if self.script is None else self.script
        return None if source is None else source.over_s

    def _require_at_most(self, most: int, *names: str) -> None:
        for name in names:
            if getattr(self.population, name) > most:
                raise InvalidValueError(
                    f"{name} must be at most {most} in {self.name!r}, got {getattr(self.population, name)}"
                )


def rooms(layout: Layout) -> tuple[tuple[int, tuple[str, ...]], ...]:
    """Return how many a place has room for, and the numbers of a `Population` that share this room."""
    feet, wheels = ("pedestrians", "children"), ("bicycles", "scooters")
    walking = 0 if layout.footways is None else layout.footways.capacity
    on_roads = (len(layout.slots), ("vehicles", "vans", "buses", "motorcycles"))
    at_kerbs = (len(layout.bays), ("parked",))
    if layout.cycleways is None:
        return on_roads, at_kerbs, (walking, feet + wheels)
    return on_roads, at_kerbs, (walking, feet), (layout.cycleways.capacity, wheels)


DENSE = (
    "vehicles",
    "trucks",
    "vans",
    "buses",
    "motorcycles",
    "parked",
    "pedestrians",
    "children",
    "bicycles",
    "scooters",
)
"""Numbers of vehicles and people, which `density` multiplies."""


NUMBERS = ("density", *(field.name for field in fields(Population)))
"""Keywords of `make_scenario`."""


class ScenarioRegistry(Registry[Place]):
    """Places by name. What is registered may also be a description, or a function that returns one or a place."""

    def get(self, name: str) -> Place:
        """Return the place called `name`, which is built when it is first asked for."""
        found: Any = super().get(name)
        if isinstance(found, Place):
            return found
        made = found() if callable(found) else found
        if not isinstance(made, (Place, PlaceDescription)):
            accepted = "a PlaceDescription, or a function that returns one"
            raise InvalidValueError(f"scenario {name!r} must be {accepted}, got {type(made).__name__}")
        self._entries[name] = made if isinstance(made, Place) else BUILDERS.get("described")(made, name)
        return self._entries[name]


SCENARIOS: Registry[Place] = ScenarioRegistry("scenario", group="coopsim.places")
"""Places by name. Installed packages add theirs through the entry-point group `coopsim.places`."""


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


def make_scenario(place: str | Place, *, density: float = 1.0, detail: str | None = None, **numbers: Any) -> Scenario:
    """Make a scenario with a place's usual population, except for `numbers`.

    Args:
        place: registered name, or a custom place.
        density: factor on the numbers of vehicles and people, but not of agents.
        detail: one of `DETAILS`; None: "full" for a described place with `furniture`, "plain" for others.
        **numbers: fields of `Population`. Without `connected_cars`, all cars are connected where there are fewer cars
            than the place's usual number of connected ones.

    Raises:
        UnknownNameError: no such scenario, number or detail.
        InvalidValueError: a number that is not accepted, or together with the one that overrides it.

    Warns:
        CrowdedWarning: some do not fit; as many as fit are there.
    """
    found = place if isinstance(place, Place) else SCENARIOS.get(place)
    wanted = wanted_numbers(found.name, found.population, density, numbers)
    if "connected_cars" not in numbers:
        cars = Population(**(wanted | {"connected_cars": 0, "rsus": 1})).cars
        wanted["connected_cars"] = min(wanted["connected_cars"], cars)
    detail = detail or usual_detail(found)
    layout, population = found.make_layout(), Population(**wanted)
    # Names of described places hold those of their files, which may change.
    identity = found.name if found.description is None else found.description.identity
    if detail != "plain" and (found.description is None or found.description.furniture is None):
        layout = FURNISHINGS.get("furniture")(identity, layout, population)
    if detail == "street":
        layout = FURNISHINGS.get("street")(identity, layout, population)
    return Scenario(found.name, layout, population, detail, found.description)


def wanted_numbers(name: str, usual: Population, density: float, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return all fields of a `Population`, those in `numbers` instead of usual ones, times the density.

    Arguments and errors are those of `make_scenario`; `name` is for errors.
    """
    known = [field.name for field in fields(Population)]
    for number in numbers:
        if number not in known:
            raise UnknownNameError(f"number of scenario {name!r}", number, NUMBERS)
    require_one_of_each(numbers)
    require_non_negative(density=density)
    wanted = {field: getattr(usual, field) for field in known} | dict(numbers)
    return wanted | {each: round(density * wanted[each]) for each in DENSE if _is_count(wanted[each])}


def usual_detail(place: Place) -> str:
    """Return the detail of a place for which none is asked: "full" if its description says what stands there."""
    return "full" if place.description is not None and place.description.furniture is not None else "plain"


def _is_count(value: object) -> bool:
    """Return whether a value can be scaled; `Population` refuses other ones in the user's words."""
    return isinstance(value, Integral) and not isinstance(value, bool)


class EpisodeScenarios(ABC):
    """The scenarios of an environment's episodes, whose agents have the same names in all of them.

    Attributes:
        name: name of the environment's scenario.
        most_actors: the largest number of actors in any of them; None: as many as are there at the start.
    """

    name: str
    most_actors: int | None = None

    @abstractmethod
    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""

    def close(self) -> None:
        """Release the scenarios' resources."""


class SameScenario(EpisodeScenarios):
    """The same scenario in all episodes."""

    def __init__(self, scenario: Scenario) -> None:
        self.name, self._scenario = scenario.name, scenario

    def of(self, seed: int) -> Scenario:
        """Return the scenario."""
        return self._scenario
