"""Scenarios that follow a log: the options, and which part of it each episode plays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.logs.play.choice import Choice, Wish, choose
from coopsim.data.logs.play.ground import flat_ground, map_ground
from coopsim.data.logs.play.logged_world import LoggedWorld
from coopsim.data.logs.reading import ENDS, read_log
from coopsim.data.logs.track_log import TrackLog
from coopsim.data.maps.place.scenarios import RADII_M, as_point
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_between, require_positive
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_options import PlaceSeeds
from coopsim.world.drawn_places import PLACE_FILES, DrawnPlaces
from coopsim.world.population import Population
from coopsim.world.scenario import EpisodeScenarios, Place, Scenario
from coopsim.world.snapshot import WorldSource

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
    """

    map: str | Path | None = None
    cars: Sequence[str] | str = ()
    start_s: float | None = None
    least_s: float = 10.0
    around: tuple[float, float] | str | None = None
    radius_m: float = 250.0
    part: str | None = None

    def __post_init__(self) -> None:
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
    """A part of a log as an episode's traffic; see `coopsim.world.scenario.Played`."""

    choice: Choice
    controls: Sequence[str] = ("traffic",)

    @property
    def over_s(self) -> float:
        """Time at which the first connected car leaves."""
        return self.choice.end_s - self.choice.start_s

    @property
    def facts(self) -> Mapping[str, Any]:
        """Time in the log at which the episode begins, and the names of the connected cars there."""
        names = [self.choice.log.ids[k] for k in self.choice.connected]
        return {"log_start_s": self.choice.start_s, "log_cars": names}

    def world(self, scenario: Scenario, seed: int) -> WorldSource:
        """Return the world."""
        return LoggedWorld(self.choice.log, self.choice.start_s, self.choice.connected, scenario, seed)


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
        self.most_actors = _most_at_once(self._log, np.ones(len(self._log.ids), bool))
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
        if options.map is None:
            layout = flat_ground(choice.log, options.radius_m)
        else:
            layout = map_ground(str(options.map), choice.middle, options.radius_m, place_seed)
        there = Population(
            vehicles=connected, truck_share=0.0, connected_cars=connected, rsus=rsus, drones=drones, pedestrians=0
        )
        return Scenario(self.name, layout, there, self._detail, place_seed=place_seed, played=PlayedPart(choice))


def _cars(numbers: Mapping[str, Any], options: LogOptions) -> dict[str, Any]:
    """Return the numbers of agents: as many cars as are named, or as are asked for."""
    if options.cars and ("connected_cars" in numbers or numbers.get("penetration") is not None):
        raise InvalidValueError("cars names the connected cars: connected_cars and penetration must be left out")
    if options.cars:
        return {**numbers, "connected_cars": len(options.cars)}
    return {"connected_cars": _USUAL_CARS, **numbers} if numbers.get("penetration") is None else dict(numbers)


def _most_at_once(log: TrackLog, of: Any) -> int:
    """Return how many of the tracks `of` are there at once, at most."""
    first, last = log.time_s[log.first[:-1]][of], log.time_s[log.first[1:] - 1][of]
    begun = np.searchsorted(np.sort(first), np.sort(first), side="right")
    gone = np.searchsorted(np.sort(last), np.sort(first), side="left")
    return int((begun - gone).max(initial=0))


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
