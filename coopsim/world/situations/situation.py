"""The seam for situations: from a seed to a place and a script that leads to a crash if nobody reacts."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_finite_number,
    require_non_negative,
    require_number,
    require_probability,
)
from coopsim.support.registry import Registry
from coopsim.support.rng import stream
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.drawn_places import TOWN, find_drawer, is_place_file, scenario_names
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import EpisodeScenarios, Place, Scenario, make_scenario
from coopsim.world.script import Script, VehicleRole, WalkRole

Range = tuple[float, float]
"""Least and greatest value of a number that each seed draws anew, with equal chances."""

NAMED = "named"
"""The place of a situation that is built in."""

EGO = "cav_0"
"""Name of the ego."""

_TOWNS = 20  # tried for an episode, until one has a site: about half of them have one
_NEXT = 1_000_003  # from a place's seed to that of the next to try, so that hardly two episodes share one
_MASTS = 3  # nearest ones, of which one is drawn
_MOST_ACTORS = 96


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A situation as it was drawn, before it is decided who is connected.

    Attributes:
        layout: the place.
        ego: the ego.
        vehicles: all other vehicles.
        people: scripted people.
        at: (2,) m, the place of the conflict.
        parked: number of vehicles in the layout's bays, besides those of the script.
    """

    layout: Layout
    ego: VehicleRole
    vehicles: tuple[VehicleRole, ...]
    people: tuple[WalkRole, ...]
    at: Floats
    parked: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation(EpisodeScenarios):
    """Scenarios of a situation.

    A subclass has further fields for what it draws, says its `named` place, and stages itself in a layout.

    Attributes:
        place: "named", the situation's own built-in place; the name of another scenario, whose place it is; "town", a
            drawn one for each seed; the path of a map, a place of it for each seed; or a custom place. Of a list of
            these each seed draws one, and passes it over for the next if it has no site; "named" is the last.
        penetration: share of the other moving cars that are connected, in [0, 1]; halves are rounded up.
        rsus: number of roadside units, 0 or 1. Each seed draws it from the three nearest masts.
        detail: "plain" or "full"; None: the usual one of the place. In a "street", people could be in a script's way.
        place_seed: seeds of drawn towns, see `coopsim.world.drawn_options.PlaceSeeds`; a town without a site is passed
            over for the next.
        over_s: time at which the situation is over.
    """

    place: str | Place | Sequence[str | Place] = NAMED
    penetration: float = 0.3
    rsus: int = 0
    detail: str | None = None
    place_seed: int | str | Sequence[int] | None = None
    over_s: float = 8.0

    named: ClassVar[str]
    """Name of the scenario with the built-in place."""
    elsewhere: ClassVar[bool] = True
    """Whether other places than the built-in one may have sites."""
    calibrated: ClassVar[bool] = True
    """Whether ranges were tuned so that a car alone crashes in about half of the seeds."""
    usual: ClassVar[Mapping[str, Any]] = {}
    """Options of its environment that are not the usual ones of situations."""
    most_actors = _MOST_ACTORS

    def __post_init__(self) -> None:
        if not self.places:
            raise InvalidValueError("place must be at least one, got an empty list")
        for place in self.places:
            self._require(place)
        if self.detail is not None:
            require_choice("detail", self.detail, ("plain", "full"))
        require_probability(penetration=self.penetration)
        require_count(0, 1, rsus=self.rsus)
        if self.place_seed is not None and not any(_is_drawn(place) for place in self.places):
            raise InvalidValueError(f"place_seed must be left out unless place is {TOWN!r}, got {self.place_seed!r}")
        PlaceSeeds(self.place_seed)
        require_between(0.1, 3600, over_s=self.over_s)
        for field in fields(self):
            if field.type == "Range":
                object.__setattr__(self, field.name, _range(field.name, getattr(self, field.name)))

    @abstractmethod
    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation in a place. None: the place has no site for it."""

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed.

        Raises:
            InvalidValueError: the place has no site for the situation.
        """
        tried = []
        for scenario in self._places(seed):
            tried.append(scenario.name)
            stage = self.stage(scenario.layout, stream(seed, "situation", self.name))
            if stage is not None:
                return self._scenario(scenario, stage, seed)
        where = f"{len(tried)} drawn towns" if len(tried) > 1 else repr(tried[0])
        raise InvalidValueError(f"place must have a site for {self.name!r}, but there is none in {where}")

    @property
    def built_in(self) -> str:
        """Name of the scenario with the built-in place."""
        return self.named

    @property
    def movable(self) -> bool:
        """Whether other places than the built-in one may have sites."""
        return self.elsewhere

    @property
    def places(self) -> tuple[str | Place, ...]:
        """The places that seeds draw from; a situation that happens in its own place only leaves out the others."""
        given = tuple(self.place) if isinstance(self.place, (list, tuple)) else (self.place,)
        return (NAMED,) if NAMED in given and not self.movable else given  # type: ignore[return-value]

    def order(self, seed: int) -> Iterator[str | Place]:
        """Yield the places in the order in which an episode tries them."""
        others = [place for place in self.places if place != NAMED]
        first = int(stream(seed, "situation", "place").integers(len(others))) if len(others) > 1 else 0
        yield from others[first:] + others[:first] + [NAMED] * (NAMED in self.places)

    def _require(self, place: object) -> None:
        """Refuse what is no place, or none for this situation."""
        if isinstance(place, Place) or is_place_file(place):
            if not self.movable:
                shown = place.name if isinstance(place, Place) else place
                raise InvalidValueError(f"place must be {NAMED!r} for {self.name!r}, got {shown!r}")
        else:
            require_choice("place", place, (NAMED, *scenario_names()) if self.movable else (NAMED,))

    def _places(self, seed: int) -> Iterator[Scenario]:
        """Yield the places to try: of drawn ones, the seed's and then others."""
        for place in self.order(seed):
            drawer = find_drawer(place)
            if drawer is None:
                yield _bare(self.built_in if place == NAMED else place, self.detail)
                continue
            seeds = PlaceSeeds(self.place_seed)
            for place_seed in dict.fromkeys(seeds.of(seed + k * _NEXT) for k in range(_TOWNS)):
                made = drawer.place(place_seed, drawer.kinds[1]())
                name, detail = TOWN if place == TOWN else made.name, self.detail or "full"
                bare = Population(1, 0.0, 0, 1)
                yield Scenario(name, made.make_layout(), bare, detail, made.description, place_seed)

    def _scenario(self, scenario: Scenario, stage: Stage, seed: int) -> Scenario:
        layout, vehicles = stage.layout, list(stage.vehicles)
        cars = [k for k, role in enumerate(vehicles) if _may_be_connected(role)]
        order = stream(seed, "situation", self.name, "connected").permutation(len(cars))
        for k in order[: math.floor(self.penetration * len(cars) + 0.5)]:
            vehicles[cars[k]] = replace(vehicles[cars[k]], connected=True)
        script = Script(stage.ego, tuple(vehicles), stage.people, self.over_s)
        near = np.argsort([exact.hypot(*(unit.translation[:2] - stage.at)) for unit in layout.rsus], kind="stable")
        if len(near):
            drawn = int(stream(seed, "situation", self.name, "mast").integers(min(_MASTS, len(near))))
            chosen = layout.rsus[near[drawn]]
            layout = replace(layout, rsus=(chosen, *(unit for unit in layout.rsus if unit is not chosen)))
        return replace(scenario, layout=layout, population=_population(script, stage.parked, self.rsus), script=script)


def _range(name: str, given: object) -> Range:
    """Return a range from a number or [least, most]; speeds must not be negative."""
    ends = given if isinstance(given, (list, tuple)) else (given, given)
    accepted = "a number or [least, most], rising"
    if len(ends) != 2:
        raise InvalidValueError(f"{name} must be {accepted}, got {given!r}")
    (require_non_negative if name.endswith("m_s") else require_finite_number)(**{name: ends[0]})
    require_number(f"{accepted}", lambda most: most >= ends[0], **{name: ends[1]})
    return float(ends[0]), float(ends[1])


def _may_be_connected(role: VehicleRole) -> bool:
    """Return whether it is drawn if a vehicle is connected."""
    return role.label == ObjectClass.CAR and role.manner != "parked" and not role.connected


def _population(script: Script, parked: int, rsus: int) -> Population:
    """Return the numbers of a script."""
    moving = [role.label for role in (script.ego, *script.vehicles) if role.manner != "parked"]
    others = ((ObjectClass.VAN, "vans"), (ObjectClass.BUS, "buses"), (ObjectClass.MOTORCYCLE, "motorcycles"))
    return Population(
        vehicles=moving.count(ObjectClass.CAR) + moving.count(ObjectClass.TRUCK),
        trucks=moving.count(ObjectClass.TRUCK),
        pedestrians=0,
        connected_cars=1 + sum(role.connected for role in script.vehicles),
        rsus=rsus,
        parked=parked,
        **{name: moving.count(label) for label, name in others},
    )


@lru_cache(8)
def _bare(place: str | Place, detail: str | None) -> Scenario:
    """Return a place with nobody in it but a car, and all its masts."""
    return make_scenario(place, detail=detail, vehicles=1, pedestrians=0, parked=0, truck_share=0.0, connected_cars=1)


def _is_drawn(place: object) -> bool:
    return place == TOWN or is_place_file(place)


SITUATIONS: Registry[type[Situation]] = Registry(
    "situation", home="coopsim.world.situations.catalogue", group="coopsim.situations"
)
"""Classes of situations. Installed packages add theirs through the entry-point group `coopsim.situations`."""
