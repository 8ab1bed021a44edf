"""Scenarios in places of a map: its options, the choice of a place, and who is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.maps.place.candidates import Places, places_of
from coopsim.data.maps.place.carla_routes import GivenRoute, read_routes, require_radius, start_on
from coopsim.data.maps.place.cut import cut_out, distances_m
from coopsim.data.maps.place.describe import describe_place
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import DRIVEN, StreetMap
from coopsim.data.maps.sumo.demand import with_demand
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.support.checks import require_between, require_flag
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.drawn_places import PLACE_FILES, DrawnPlaces
from coopsim.world.places.layout import Layout
from coopsim.world.places.place import BUILDERS
from coopsim.world.population import Population
from coopsim.world.scenario import (
    MOST_BYSTANDERS,
    NUMBERS,
    EpisodeScenarios,
    Place,
    Scenario,
    make_scenario,
    rooms,
    wanted_numbers,
)

RADII_M = (60.0, 600.0)
"""Accepted radii of places."""

_KEPT_MAPS, _KEPT_PLACES = 2, 4
_USUAL = Population(vehicles=30, pedestrians=15, connected_cars=3, rsus=1, parked=40, bicycles=4)
_FEWEST = 3  # vehicles of which one surely has the first start
_FREE_SHARE = 0.6  # of starts: no more are taken


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Options of places of a map.

    Attributes:
        around: middle of the place (x, y) in the map's plane, m, also as a text "X,Y"; None: places are the map's
            junctions, those far apart first.
        radius_m: radius of the place, 60 to 600 m. Junctions lie at least 20 m within it.
        seed_places: another place, or other surroundings `around` the same one, for every place seed; False: all
            episodes are in the same place.
        demand: file of SUMO's demand for the map (.rou.xml): vehicles turn, start and come in as often as it says.
        routes: file of routes of CARLA's leaderboard (.xml). `cav_0` starts on the one whose turn it is by the place
            seed, in a place around it; steered, it has its end as the goal, and others have goals as far.
    """

    around: tuple[float, float] | str | None = None
    radius_m: float = 250.0
    seed_places: bool = True
    demand: str | Path | None = None
    routes: str | Path | None = None

    def __post_init__(self) -> None:
        require_between(*RADII_M, radius_m=self.radius_m)
        require_flag(seed_places=self.seed_places)
        object.__setattr__(self, "radius_m", float(self.radius_m))
        if self.routes is not None and self.around is not None:
            raise InvalidValueError(f"around must be left out with routes, got {self.around!r}")
        if self.around is not None:
            object.__setattr__(self, "around", as_point(self.around))


def as_point(given: Any) -> tuple[float, float]:
    """Return a point from two numbers, or from a text of them."""
    try:
        x, y = map(float, given.split(",") if isinstance(given, str) else given)
        if not np.isfinite([x, y]).all():
            raise ValueError
    except (TypeError, ValueError):
        raise InvalidValueError(f"around must be two numbers, x and y in m, or a text 'X,Y', got {given!r}") from None
    return x, y


@dataclass(frozen=True, slots=True)
class _Needs:
    """Needs of the agents: starts, places for roadside units, and starts from where one can drive without end."""

    starts: int
    rsus: int
    stays: int = 0

    def lacking(self, place: Place) -> str | None:
        """Say what a place lacks; None: nothing."""
        layout = place.make_layout()
        if len(layout.slots) < self.starts:
            return f"places with less than {self.starts} starts for vehicles"
        if len(layout.rsus) < self.rsus:
            return f"places with less than {self.rsus} places for roadside units"
        endless = layout.network.endless
        if sum(slot.lane[:2] in endless for slot in layout.slots) < self.stays:
            return "places that connected cars would have to leave"
        return None


@dataclass(frozen=True, slots=True, eq=False)
class _File:
    """A map file that is read, and what was found in it."""

    path: str
    streets: StreetMap
    places: dict[float, Places] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Its name without the ends."""
        return Path(self.path).name.split(".")[0]

    def places_in(self, radius_m: float) -> Places:
        """Return the places with a radius."""
        if radius_m not in self.places:
            self.places[radius_m] = places_of(self.streets, radius_m)
        return self.places[radius_m]


def open_file(path: str, demand: str | None = None) -> _File:
    """Read a map and the demand on it, or return them as they were read before; files that change are read anew.

    Raises:
        MapFileError: see `coopsim.data.maps.reading.read_map` and `coopsim.data.maps.sumo.demand.with_demand`.
    """
    files = [Path(each) for each in (path, demand) if each is not None]
    states = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in files if file.is_file())
    return _read(path, demand, states)


@lru_cache(_KEPT_MAPS)
def _read(path: str, demand: str | None, states: Any) -> _File:
    streets = read_map(path)
    return _File(path, streets if demand is None else with_demand(streets, demand))


@lru_cache(_KEPT_PLACES)
def draw_place(
    file: _File, options: MapOptions, place_seed: int, needs: _Needs, route: GivenRoute | None = None
) -> Place:
    """Draw a place of a map: that of a route or `around` a point, else the one whose turn it is, or a next one.

    Raises:
        InvalidValueError: nothing can be driven there; says why.
    """
    if route is not None:
        require_radius(route, RADII_M[1])
        wide = replace(options, radius_m=max(options.radius_m, route.radius_m))
        return _built(file, wide, route.around, place_seed, replace(needs, stays=0))
    if options.around is not None:
        assert not isinstance(options.around, str), "it was read"
        _require_near(file, options.around)
        return _built(file, options, options.around, place_seed, replace(needs, stays=0))
    found = file.places_in(options.radius_m)
    reasons = dict(found.left_out)
    for k in range(len(found.centres)):
        x, y = found.centres[(place_seed + k) % len(found.centres)].tolist()
        try:
            return _built(file, options, (x, y), place_seed, needs)
        except CoopsimError as error:
            reason = str(error)
            reasons[reason] = reasons.get(reason, 0) + 1
    said = "; ".join(f"{count} {reason}" for reason, count in reasons.items()) or "no lane is 60 m long"
    raise InvalidValueError(
        f"{file.path} has no place with radius_m={options.radius_m:g} that can be driven: {said}. Accepted: another "
        "radius_m, or around=(x, y)"
    )


def _routes_of(options: MapOptions) -> tuple[GivenRoute, ...]:
    return () if options.routes is None else read_routes(options.routes)


def _whose_turn(routes: Sequence[GivenRoute], place_seed: int) -> GivenRoute | None:
    return routes[place_seed % len(routes)] if routes else None


@lru_cache(_KEPT_PLACES)
def _started(
    file: _File, options: MapOptions, place_seed: int, needs: _Needs, route: GivenRoute
) -> tuple[Layout, float]:
    """Return the place of a route with the start there, and the length of the route, m."""
    return start_on(draw_place(file, options, place_seed, needs, route).make_layout(), route, route.around)


def _require_near(file: _File, around: tuple[float, float]) -> None:
    lines = [lane.line for lane in file.streets.lanes.values() if lane.kind in DRIVEN]
    if not lines or float(distances_m(lines, np.array(around)).min()) > RADII_M[0]:
        points = np.concatenate(lines or [np.zeros((1, 3))])[:, :2]
        (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        raise InvalidValueError(
            f"around must be at most {RADII_M[0]:g} m from a lane of {file.path}, got {around}: its lanes reach from "
            f"({x0:.0f}, {y0:.0f}) to ({x1:.0f}, {y1:.0f})"
        )


def place_around(file: _File, around: tuple[float, float], radius_m: float, seed: int) -> Place:
    """Build the place of a map around a point (x, y) in the map's plane, m; `seed` decides what the map lacks.

    Raises:
        InvalidValueError: it cannot be driven.
    """
    cut = cut_out(file.streets, around, radius_m)
    if not any(lane.kind in DRIVEN for lane in cut.lanes.values()):
        raise InvalidValueError(f"no lane within radius_m={radius_m:g} of {around} leads to a junction there")
    return BUILDERS.get("drawn")(describe_place(cut, seed), f"{file.name}-{seed}")


def _built(file: _File, options: MapOptions, around: tuple[float, float], seed: int, needs: _Needs) -> Place:
    """Build the place around a point.

    Raises:
        InvalidValueError: it cannot be driven, or lacks room for the agents.
    """
    place = place_around(file, around, options.radius_m, seed)
    lacking = needs.lacking(place)
    if lacking is not None:
        raise InvalidValueError(lacking)
    return place


class MapScenarios(EpisodeScenarios):
    """Scenarios in places of a map, with the same agents in all of them.

    Arguments and errors are those of `DrawnPlaces.scenarios`.
    """

    def __init__(
        self,
        file: _File,
        seeds: PlaceSeeds,
        options: MapOptions,
        density: float,
        detail: str | None,
        numbers: Mapping[str, Any],
    ) -> None:
        for name in numbers:
            if name not in NUMBERS:
                raise UnknownNameError("option of maps", name, (*NUMBERS, "detail"))
        self.name = file.name
        self._file, self._options, self._density, self._detail = file, options, density, detail or "full"
        self._seeds = seeds if options.seed_places or seeds.place_seed is not None else PlaceSeeds(0)
        self._routes = _routes_of(options)
        self._asked = {"rsus": _USUAL.rsus, "drones": 0, **numbers}
        if numbers.get("penetration") is None:
            self._asked.setdefault("connected_cars", _USUAL.connected_cars)
        elif "vehicles" not in numbers:
            raise InvalidValueError("penetration needs vehicles in places of a map: the agents must be the same in all")
        most = self._wanted(_USUAL)
        self._needs = _Needs(3 * most.connected, most.rsus, most.connected)
        self._find_first("rsus" in numbers)
        self.most_actors = sum(most.on_roads.values()) + sum(most.people.values()) + most.parked
        self.most_actors += MOST_BYSTANDERS if self._detail == "street" else 0

    def _find_first(self, units_asked: bool) -> None:
        """Require a place for the first episode.

        Where there is none, cars may have to leave it; it has no units if none was asked for and no place has room.
        """
        choices = [self._needs, replace(self._needs, stays=0)]
        choices += [] if units_asked else [replace(needs, rsus=0) for needs in choices]
        for left, self._needs in zip(reversed(range(len(choices))), choices, strict=True):
            self._asked["rsus"] = min(self._asked["rsus"], self._needs.rsus)
            try:
                self.of(0)
                return
            except InvalidValueError:
                if not left:
                    raise

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the place that belongs to the episode with this seed."""
        place_seed = self._seeds.of(seed)
        route = _whose_turn(self._routes, place_seed)
        place = draw_place(self._file, self._options, place_seed, self._needs, route)
        layout = place.make_layout()
        most = max(self._needs.starts, int(_FREE_SHARE * len(layout.slots)))
        population = self._fitting(self._wanted(replace(_USUAL, vehicles=min(_USUAL.vehicles, most))), layout)
        population = population.within(most, *rooms(layout)[0][1])  # more would stand in jams
        made = make_scenario(place, detail=self._detail, **population.numbers)
        made = replace(made, name=self.name, place_seed=place_seed)
        if route is None:
            return made
        if sum(population.on_roads.values()) < _FEWEST:
            raise InvalidValueError(f"vehicles must be at least {_FEWEST} with routes, got {population.vehicles}")
        layout, length_m = _started(self._file, self._options, place_seed, self._needs, route)
        return replace(made, layout=layout, route_m=(length_m, length_m))

    def _wanted(self, usual: Population) -> Population:
        return Population(**wanted_numbers(self.name, usual, self._density, self._asked))

    def _fitting(self, population: Population, layout: Layout) -> Population:
        """Reduce numbers that are too large for a place: those not asked for quietly, and first."""
        for room, names in rooms(layout):
            unasked = [name for name in reversed(names) if name not in self._asked]
            asked = sum(getattr(population, name) for name in names if name in self._asked)
            population = population.within(max(0, room - asked), *unasked, quietly=True)
        return population


class MapPlaces(DrawnPlaces):
    """Places of the map in a file."""

    kinds = (PlaceSeeds, MapOptions)

    def __init__(self, path: str) -> None:
        self._path = path

    def place(self, place_seed: int, options: Any) -> Place:
        route = _whose_turn(_routes_of(options), place_seed)
        return draw_place(self._opened(options), options, place_seed, _Needs(0, 0), route)

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> MapScenarios:
        return MapScenarios(self._opened(options), seeds, options, density, detail, numbers)

    def _opened(self, options: MapOptions) -> _File:
        return open_file(self._path, None if options.demand is None else str(options.demand))


for _end in (".xodr", ".net.xml", ".osm"):
    PLACE_FILES.register(_end)(MapPlaces)
