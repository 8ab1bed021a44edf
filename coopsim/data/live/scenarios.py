"""Scenarios in which SUMO drives: in a network with its demand, or in drawn towns."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from coopsim.data.live.demand import begin_of, circuits
from coopsim.data.live.engine import SumoEngine, SumoRun, step_for
from coopsim.data.live.sumo_world import MOST_SHOWN, SumoWorld
from coopsim.data.logs.filling import Columns, make_log
from coopsim.data.logs.play.choice import Wish, choose
from coopsim.data.logs.play.ground import map_ground
from coopsim.data.logs.track_log import TrackLog
from coopsim.data.maps.export.sumo.network import make_network, plain_files
from coopsim.data.maps.export.town_network import town_network
from coopsim.data.maps.place.scenarios import RADII_M, as_point, open_file
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_between, require_finite_number, require_non_negative
from coopsim.support.rng import stream
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.drawn_places import LIVE_TRAFFIC, TOWN, DrawnPlaces, find_drawer
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.scenario import EpisodeScenarios, Place, Scenario
from coopsim.world.snapshot import WorldSource

CONTROLS = ("traffic", "acceleration", "planner")
_SUFFIXES = (".net.xml", ".net.xml.gz")
_WARM_S, _SPREAD_S = 60.0, 240.0
"""Least time from the first departure to an episode, and how much later it may begin."""
_TOWN_M = 2000.0  # all of it
_TRIES, _OTHER = 8, 2**40  # places to try, and how far apart their seeds are
_NUMBERS = ("connected_cars", "rsus", "drones")
_USUAL = {"vehicles": 30, "connected_cars": 3, "rsus": 0, "pedestrians": 0}


@dataclass(frozen=True, slots=True)
class SumoOptions:
    """Options of episodes in a network of SUMO.

    Attributes:
        demand: file of the demand (.rou.xml); None: vehicles as many as asked for go to and fro.
        around: middle of the place (x, y) in the network's plane, m, also as a text "X,Y"; None: the first connected
            car's. Vehicles are simulated in the whole network, and sensed in the place.
        radius_m: radius of the place, 60 to 600 m.
        start_s: SUMO's time at which episodes begin; None: drawn for each place seed, 60 to 300 s after the first
            departure.
        least_s: time for which all connected cars stay in the place, if SUMO drives them.
    """

    demand: str | Path | None = None
    around: tuple[float, float] | str | None = None
    radius_m: float = 250.0
    start_s: float | None = None
    least_s: float = 10.0

    def __post_init__(self) -> None:
        require_between(*RADII_M, radius_m=self.radius_m)
        require_non_negative(least_s=self.least_s)
        if self.start_s is not None:
            require_finite_number(start_s=self.start_s)
        if self.around is not None:
            object.__setattr__(self, "around", as_point(self.around))


@dataclass(frozen=True, slots=True, eq=False)
class LivePart:
    """SUMO as an episode's traffic; see `coopsim.world.scenario.Played`."""

    engine: SumoEngine
    run: SumoRun
    start_s: float
    cars: Sequence[str]
    middle: np.ndarray
    radius_m: float
    controls: Sequence[str] = CONTROLS
    _worlds: list[SumoWorld] = field(default_factory=list)

    @property
    def over_s(self) -> float:
        """Time at which the first connected car left; infinite as long as all are there."""
        left_s = self._worlds[-1].left_s if self._worlds else None
        return np.inf if left_s is None else left_s

    @property
    def facts(self) -> Mapping[str, Any]:
        """SUMO's time at which the episode begins, and its names of the connected cars."""
        return {"sumo_start_s": self.start_s, "sumo_cars": list(self.cars)}

    def world(self, scenario: Scenario, seed: int) -> WorldSource:
        """Return the world, for which SUMO begins anew."""
        self.engine.start(self.run)
        self.engine.go_on(self.start_s)
        made = SumoWorld(self.engine, self.run.step_s, self.cars, scenario, self.middle, self.radius_m, seed)
        self._worlds[:] = [made]
        return made


class SumoScenarios(EpisodeScenarios):
    """Scenarios in which SUMO drives."""

    most_actors = MOST_SHOWN

    def __init__(self, seeds: PlaceSeeds, dt_s: float) -> None:
        self._seeds, self._dt_s, self._step_s = seeds, dt_s, step_for(dt_s)
        self._engine = SumoEngine()
        self._last: tuple[int, Scenario] | None = None

    @abstractmethod
    def _made(self, seed: int) -> Scenario:
        """Return the scenario of an episode."""

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""
        if self._last is None or self._last[0] != seed:
            self._last = seed, self._made(seed)
        return self._last[1]

    def close(self) -> None:
        """Let other environments have SUMO."""
        self._engine.close()

    def _part(self, run: SumoRun, log: TrackLog, wish: Wish, seed: int) -> LivePart:
        """Choose the connected cars and the place by what SUMO will do if it drives them.

        Raises:
            InvalidValueError: there are not so many cars for so long.
        """
        choice = choose(log, wish, seed)
        names = [choice.log.ids[k] for k in choice.connected]
        return LivePart(self._engine, run, choice.start_s, names, choice.middle, wish.radius_m)

    def _look_ahead(self, run: SumoRun, wish: Wish) -> TrackLog:
        """Return what SUMO does for the time of a wish if it drives all."""
        assert wish.start_s is not None, "it was drawn"
        self._engine.start(run)
        times_s = (wish.start_s + self._dt_s * np.arange(np.ceil(wish.least_s / self._dt_s - 1e-9) + 1)).round(3)
        moments = []
        for time_s in times_s.tolist():
            self._engine.go_on(time_s)
            moments.append(self._engine.users())
        kind = np.concatenate([each.kind for each in moments])
        columns = Columns(
            time_s=np.repeat(times_s, [len(each.names) for each in moments]),
            id=np.array([name for each in moments for name in each.names]),
            label=self._engine.label[kind],
            xy=np.concatenate([each.place for each in moments]),
            heading=np.concatenate([each.heading for each in moments]),
            velocity=np.concatenate([each.velocity for each in moments]),
            size=self._engine.size[kind],
            step_s=self._dt_s,
        )
        return make_log("SUMO's traffic", "sumo", columns)


class NetworkScenarios(SumoScenarios):
    """Scenarios in a network of SUMO.

    Arguments and errors are those of `DrawnPlaces.scenarios`.
    """

    def __init__(
        self, path: Path, seeds: PlaceSeeds, dt_s: float, options: SumoOptions, detail: str | None, numbers: Any
    ) -> None:
        super().__init__(seeds, dt_s)
        accepted = _NUMBERS if options.demand is not None else (*_NUMBERS, "vehicles", "truck_share", "pedestrians")
        for name in numbers:
            if name not in accepted:
                raise UnknownNameError('option of a network with traffic="sumo"', name, accepted)
        self.name, self._detail = path.name.split(".")[0], detail or "full"
        self._path, self._options = path, options
        self._population = Population(**{**_USUAL, **numbers, **({"vehicles": 10_000} if options.demand else {})})
        self._begin_s = 0.0 if options.demand is None else begin_of(Path(options.demand))
        self.of(0)

    def _made(self, seed: int) -> Scenario:
        options, place_seed = self._options, self._seeds.of(seed)
        rng = stream(place_seed, "sumo")
        start_s = options.start_s
        if start_s is None:
            start_s = self._begin_s + _WARM_S + round(rng.uniform(0.0, _SPREAD_S) / self._step_s) * self._step_s
        elif start_s < self._begin_s:
            raise InvalidValueError(f"start_s must be at least {self._begin_s:g}, the first departure, got {start_s:g}")
        # The place is where cars are: with one place seed, and nowhere to be around, their traffic is the same.
        traffic_seed = place_seed if options.around is None else seed
        streets, demand = open_file(str(self._path)).streets, options.demand
        trips = circuits(streets, self._population, traffic_seed) if demand is None else Path(demand)
        run = SumoRun(self._path, trips, traffic_seed, self._step_s, self._begin_s)
        assert not isinstance(options.around, str), "it was read"
        wish = Wish(
            connected=self._population.connected_cars,
            start_s=round(start_s, 3),
            around=options.around,
            radius_m=options.radius_m,
            least_s=options.least_s,
        )
        log, tries = self._look_ahead(run, wish), _TRIES if options.around is None else 1
        for number in range(tries):
            part = self._part(run, log, wish, place_seed + number * _OTHER)
            try:
                layout = map_ground(str(self._path), part.middle, options.radius_m, place_seed)
                break
            except InvalidValueError:  # some places of a map cannot be driven, and are not built
                if number == tries - 1:
                    raise
        return _scenario(self.name, layout, self._population, self._detail, place_seed, part)


def _scenario(
    name: str, layout: Layout, population: Population, detail: str, place_seed: int, part: LivePart
) -> Scenario:
    agents = {each: getattr(population, each) for each in ("rsus", "drones")}
    cars = population.connected
    there = Population(vehicles=cars, truck_share=0.0, connected_cars=cars, pedestrians=0, **agents)
    return Scenario(name, layout, there, detail, place_seed=place_seed, played=part)


class SumoNetworks(DrawnPlaces):
    """Places of a network, in which SUMO drives."""

    kinds = (PlaceSeeds, SumoOptions)

    def __init__(self, path: str, dt_s: float) -> None:
        self._path, self._dt_s = Path(path), dt_s

    def place(self, place_seed: int, options: Any) -> Place:
        raise InvalidValueError("with traffic=\"sumo\" the place is where an episode's cars are")

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> NetworkScenarios:
        if density != 1.0:
            raise InvalidValueError(f'density must be 1 in a network with traffic="sumo", got {density!r}')
        return NetworkScenarios(self._path, seeds, self._dt_s, options, detail, numbers)


class TownScenarios(SumoScenarios):
    """Scenarios in drawn towns, whose vehicles and people go to and fro.

    Args:
        towns: the towns, with our traffic.
        seeds: seeds of the towns.
        dt_s: time between frames.
        options: options of the towns.
    """

    def __init__(self, towns: EpisodeScenarios, seeds: PlaceSeeds, dt_s: float, options: TownOptions) -> None:
        super().__init__(seeds, dt_s)
        self.name, self._towns, self._options = towns.name, towns, options
        self.of(0)

    def _made(self, seed: int) -> Scenario:
        drawn, place_seed = self._towns.of(seed), self._seeds.of(seed)
        network, streets = _network_of(place_seed, self._options)
        run = SumoRun(network, circuits(streets, drawn.population, seed), seed, self._step_s, 0.0)
        wish = Wish(
            connected=drawn.population.connected, start_s=_WARM_S, around=(0.0, 0.0), radius_m=_TOWN_M, least_s=0.0
        )
        part = self._part(run, self._look_ahead(run, wish), wish, seed)
        made = _scenario(self.name, drawn.layout, drawn.population, drawn.detail, place_seed, part)
        return replace(made, description=drawn.description)


@lru_cache(4)
def _network_of(place_seed: int, options: TownOptions) -> tuple[str, StreetMap]:
    """Return a drawn town as a network of SUMO, and as the map that this is."""
    town = town_network(place_seed, options)
    text = make_network(plain_files(town), left_hand=town.inner_left < 0)
    with TemporaryDirectory() as folder:
        file = Path(folder, "town.net.xml")
        file.write_text(text, encoding="utf-8")
        return text, read_map(file)


class SumoTowns(DrawnPlaces):
    """Drawn towns, in which SUMO drives."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s

    def place(self, place_seed: int, options: Any) -> Place:
        return _towns().place(place_seed, options)

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> TownScenarios:
        return TownScenarios(
            _towns().scenarios(seeds, options, density, detail, numbers), seeds, self._dt_s, options
        )


def _towns() -> DrawnPlaces:
    towns = find_drawer(TOWN)
    assert towns is not None, "they are drawn"
    return towns


@LIVE_TRAFFIC.register("sumo")
def sumo_places(scenario: object, dt_s: float) -> DrawnPlaces:
    """Return what draws the places of a scenario in which SUMO drives.

    Raises:
        InvalidValueError: it is neither a network of SUMO nor "town".
    """
    if scenario == TOWN:
        return SumoTowns(dt_s)
    if isinstance(scenario, (str, Path)) and str(scenario).lower().endswith(_SUFFIXES):
        return SumoNetworks(str(scenario), dt_s)
    raise InvalidValueError(f'traffic="sumo" needs a network of SUMO (.net.xml) or {TOWN!r}, got {str(scenario)!r}')
