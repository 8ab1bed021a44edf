"""Scenarios that follow a log: the options, and which part of it each episode plays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.logs.play.choice import Choice, Wish, choose
from coopsim.data.logs.play.drivers import DRIVERS
from coopsim.data.logs.play.ground import flat_ground, map_ground
from coopsim.data.logs.play.logged_world import LoggedWorld
from coopsim.data.logs.play.lots import drawn_lots
from coopsim.data.logs.reading import ENDS, read_log
from coopsim.data.logs.track_log import TrackLog, most_at_once
from coopsim.data.maps.place.scenarios import RADII_M, as_point
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_between, require_choice, require_flag, require_positive
from coopsim.types import Mask
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.drawn_places import PLACE_FILES, DrawnPlaces
from coopsim.world.population import Population
from coopsim.world.scenario import EpisodeScenarios, Place, Scenario
from coopsim.world.snapshot import WorldSource

OTHERS = ("log", "idm")
CONTROLS = ("traffic", "acceleration", "planner")
"""Values of the option `control` in logs: a car on its logged way can be told no maneuvers."""

_KEPT = 2
_USUAL_CARS = 3
_NUMBERS = ("connected_cars", "penetration", "rsus", "drones")


@dataclass(frozen=True, slots=True)
class LogOptions:
    """Options of episodes that follow a log.

    Attributes:
        map: map file in the plane of the log; None: flat ground, where nothing hides anything but road users.
        cars: names in the log of the connected cars, in the agents' order; empty: drawn among the cars.
        start_s: time in the log at which episodes begin; None: drawn for each seed.
        least_s: time for which all connected cars must be there. An episode ends when the first of them leaves.
        around: middle of the place (x, y) in the log's plane, m, also as a text "X,Y"; None: the first connected car's.
        radius_m: radius of the place, 60 to 600 m; road users beyond are left out.
        part: case of a table of INTERACTION; None: the first.
        lots: whether houses are drawn where no road user of the log ever goes; for logs without a map.
        others: behaviour of vehicles that are not connected: "log" (follow it) or "idm" (react as drivers on their
            ways).
    """

    map: str | Path | None = None
    cars: Sequence[str] | str = ()
    start_s: float | None = None
    least_s: float = 10.0
    around: tuple[float, float] | str | None = None
    radius_m: float = 250.0
    part: str | None = None
    others: str = "log"
    lots: bool = False

    def __post_init__(self) -> None:
        require_choice("others", self.others, OTHERS)
        require_flag(lots=self.lots)
        if self.lots and self.map is not None:
            raise InvalidValueError("lots are drawn for logs without a map, which has its own: accepted with map=None")
        require_between(*RADII_M, radius_m=self.radius_m)
        require_positive(least_s=self.least_s)
        names = self.cars.split(",") if isinstance(self.cars, str) else [str(each) for each in self.cars]
        object.__setattr__(self, "cars", tuple(name.strip() for name in names if name.strip()))
        if len(set(self.cars)) < len(self.cars):
            raise InvalidValueError(f"cars must be different names, got {', '.join(self.cars)}")
        if self.around is not None:
            object.__setattr__(self, "around", as_point(self.around))


def open_log(path: str, part: str | None) -> TrackLog:
    """Read a log, or return it as it was read before; a file that changes is read anew."""
    file = Path(path)
    state = file.stat() if file.is_file() else None
    return _read(path, part, None if state is None else (state.st_mtime_ns, state.st_size))


@lru_cache(_KEPT)
def _read(path: str, part: str | None, state: Any) -> TrackLog:
    return read_log(path, part)


@dataclass(frozen=True, slots=True, eq=False)
class PlayedPart:
    """A part of a log as an episode's traffic; see `coopsim.world.scenario.Played`.

    Attributes:
        choice: the part.
        others: see `LogOptions`.
        lots: number of houses that were drawn; None: none were asked for.
    """

    choice: Choice
    others: str = "log"
    lots: int | None = None

    @property
    def over_s(self) -> float:
        """Time at which the first connected car leaves, where none is driven."""
        return self.choice.end_s - self.choice.start_s

    @property
    def facts(self) -> Mapping[str, Any]:
        """Time in the log at which the episode begins, the names of the connected cars there, what was drawn."""
        names = [self.choice.log.ids[k] for k in self.choice.connected]
        drawn = {} if self.lots is None else {"log_lots": self.lots}
        return {"log_start_s": self.choice.start_s, "log_cars": names, **drawn}

    def world(
        self, scenario: Scenario, seed: int, *, control: str = "traffic", driven: Sequence[str] | None = None
    ) -> WorldSource:
        """Return the world.

        Raises:
            CoopsimError: cars cannot be driven so, or there is no car of a name.
        """
        require_choice("control of the cars in a log", control, CONTROLS)
        cars = [f"cav_{k}" for k in range(len(self.choice.connected))]
        for name in driven or ():
            require_choice("connected car in driven_agents", name, cars)
        if control == "traffic":
            numbers: list[int] = []
        else:
            numbers = [cars.index(name) for name in (cars if driven is None else driven)]
        choice = self.choice.going_on() if numbers else self.choice
        return LoggedWorld(choice, numbers, scenario, seed, idm=self.others == "idm")


class LogScenarios(EpisodeScenarios):
    """Scenarios that follow a log, with the same number of agents in all of them.

    Arguments and errors are those of `DrawnPlaces.scenarios`.
    """

    def __init__(
        self,
        path: str,
        seeds: PlaceSeeds,
        options: LogOptions,
        density: float,
        detail: str | None,
        numbers: Mapping[str, Any],
    ) -> None:
        for name in numbers:
            if name not in _NUMBERS:
                raise UnknownNameError("option of logs, whose road users are what they are,", name, _NUMBERS)
        if density != 1.0:
            raise InvalidValueError(f"density must be 1 in a log, whose road users are what they are, got {density!r}")
        self.name, self._detail = Path(path).name.split(".")[0], detail or "plain"
        self._log, self._seeds, self._options = open_log(path, options.part), seeds, options
        alive = _most_at_once(self._log, self._log.label == ObjectClass.CAR)
        counted = Population(
            vehicles=max(alive, 1), truck_share=0.0, **{"rsus": 0, "drones": 0, **_cars(numbers, options)}
        )
        self._agents = (counted.connected, counted.rsus, counted.drones)
        every, drives = np.ones(len(self._log.ids), bool), np.isin(self._log.label, DRIVERS)
        kinds = (every,) if options.others == "log" else (drives, ~drives)
        # Driven cars may be there longer than in the log, and no more drivers are let in than were there at once.
        self.most_actors = counted.connected + sum(_most_at_once(self._log, kind) for kind in kinds)
        self.of(0)

    def of(self, seed: int) -> Scenario:
        """Return the scenario of the episode with this seed."""
        place_seed, options = self._seeds.of(seed), self._options
        connected, rsus, drones = self._agents
        around = options.around
        assert not isinstance(around, str) and not isinstance(options.cars, str), "they were read"
        wish = Wish(
            connected=connected,
            ids=tuple(options.cars),
            start_s=options.start_s,
            around=around,
            radius_m=options.radius_m,
            least_s=options.least_s,
        )
        choice = choose(self._log, wish, place_seed)
        lots = None
        if options.map is not None:
            layout = map_ground(str(options.map), choice.middle, options.radius_m, place_seed)
        elif options.lots:
            houses, outlines = drawn_lots(self._log, choice.middle, options.radius_m, place_seed)
            layout, lots = flat_ground(choice.log, options.radius_m, houses, outlines), len(houses)
        else:
            layout = flat_ground(choice.log, options.radius_m)
        there = Population(
            vehicles=connected, truck_share=0.0, connected_cars=connected, rsus=rsus, drones=drones, pedestrians=0
        )
        played = PlayedPart(choice, options.others, lots)
        return Scenario(self.name, layout, there, self._detail, place_seed=place_seed, played=played)


def _cars(numbers: Mapping[str, Any], options: LogOptions) -> dict[str, Any]:
    """Return the numbers of agents: as many cars as are named, or as are asked for."""
    if options.cars and ("connected_cars" in numbers or numbers.get("penetration") is not None):
        raise InvalidValueError("cars names the connected cars: connected_cars and penetration must be left out")
    if options.cars:
        return {**numbers, "connected_cars": len(options.cars)}
    return {"connected_cars": _USUAL_CARS, **numbers} if numbers.get("penetration") is None else dict(numbers)


def _most_at_once(log: TrackLog, of: Mask) -> int:
    """Return how many of the tracks `of` (T,) are there at once, at most."""
    return most_at_once(log.time_s[log.first[:-1]][of], log.time_s[log.first[1:] - 1][of])


class LogPlaces(DrawnPlaces):
    """Parts of the log in a file."""

    kinds = (PlaceSeeds, LogOptions)

    def __init__(self, path: str) -> None:
        self._path = path

    def place(self, place_seed: int, options: Any) -> Place:
        raise InvalidValueError(f"{self._path} is a log of traffic, which has no place of its own; accepted: a map")

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> LogScenarios:
        return LogScenarios(self._path, seeds, options, density, detail, numbers)


for _end in dict.fromkeys(end.removesuffix(".gz") for end in ENDS):
    PLACE_FILES.register(_end)(LogPlaces)
