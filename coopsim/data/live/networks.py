"""Scenarios in a network of SUMO with its demand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from coopsim.data.live.demand import begin_of, circuits
from coopsim.data.live.engine import SumoRun
from coopsim.data.live.episodes import WARM_S, SumoScenarios, scenario_of
from coopsim.data.logs.play.choice import Wish
from coopsim.data.maps.place.scenarios import RADII_M, as_point, open_file, place_around
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_between, require_finite_number, require_non_negative
from coopsim.support.rng import stream
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.drawn_places import DrawnPlaces
from coopsim.world.population import Population
from coopsim.world.scenario import Place, Scenario

_SPREAD_S = 240.0  # how much later than the least time an episode may begin
_TRIES, _OTHER = 8, 2**40  # places to try, and how far apart their seeds are
_NUMBERS = ("connected_cars", "rsus", "drones")
_USUAL = {"vehicles": 30, "connected_cars": 3, "rsus": 0, "pedestrians": 0}
_place = lru_cache(4)(place_around)


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
            start_s = self._begin_s + WARM_S + round(rng.uniform(0.0, _SPREAD_S) / self._step_s) * self._step_s
        elif start_s < self._begin_s:
            raise InvalidValueError(f"start_s must be at least {self._begin_s:g}, the first departure, got {start_s:g}")
        # The place is where cars are: with one place seed, and nowhere to be around, their traffic is the same.
        traffic_seed = place_seed if options.around is None else seed
        file, demand = open_file(str(self._path)), options.demand
        trips = circuits(file.streets, self._population, traffic_seed) if demand is None else Path(demand)
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
                x, y = part.middle.tolist()
                layout = _place(file, (x, y), options.radius_m, place_seed).make_layout()
                break
            except InvalidValueError:  # some places of a map cannot be driven, and are not built
                if number == tries - 1:
                    raise
        return scenario_of(self.name, layout, self._population, self._detail, place_seed, part)


class SumoNetworks(DrawnPlaces):
    """Places of a network, in which SUMO drives."""

    kinds = (PlaceSeeds, SumoOptions)

    def __init__(self, path: str, dt_s: float) -> None:
        self._path, self._dt_s = Path(path), dt_s

    def place(self, place_seed: int, options: Any) -> Place:
        raise InvalidValueError('with traffic="sumo" the place is where an episode\'s cars are')

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> NetworkScenarios:
        if density != 1.0:
            raise InvalidValueError(f'density must be 1 in a network with traffic="sumo", got {density!r}')
        return NetworkScenarios(self._path, seeds, self._dt_s, options, detail, numbers)
