"""The world of an episode that follows a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from coopsim.data.logs.play.choice import Choice
from coopsim.data.logs.play.drivers import Drivers
from coopsim.data.logs.play.shapes import fitted_models
from coopsim.geometry import exact
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.rng import uniform_numbers
from coopsim.types.driving import CarState, Command, acceleration_of
from coopsim.world.models.paint import draw_colors
from coopsim.world.places.layout import Cars
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody, StaticPart


class LoggedWorld:
    """Road users at the places where a log has them, but for those that have left it; see `DrivenWorld`.

    Args:
        choice: the part that is played.
        driven: numbers of the connected cars that leave their log: they obey accelerations.
        scenario: the surroundings, roadside units and drones.
        seed: the episode's: models and colours.
        idm: whether other vehicles react as drivers.
    """

    conflict_ids: tuple[int, ...] = ()

    def __init__(self, choice: Choice, driven: Sequence[int], scenario: Scenario, seed: int, *, idm: bool) -> None:
        log = self._log = choice.log
        self._start_s, self._end_s, self._connected = choice.start_s, choice.end_s, choice.connected
        self.models, self._model = fitted_models(log.label, log.size, scenario.models, seed)
        self.static: tuple[StaticPart, ...] = scenario.static
        self.map = scenario.road_map
        self._layout, self._population = scenario.layout, scenario.population
        ids = np.arange(1, len(log.ids) + 1)
        self._colors = draw_colors(seed, ids, log.label, dirty=scenario.detail != "plain")
        self._phase = uniform_numbers(seed, "phase", ids, 1)[:, 0]
        self._cycle_m = np.array([model.cycle_m for model in self.models])[self._model]
        self._size = np.array([model.size_m for model in self.models])[self._model]
        self._travelled_m = np.zeros(len(ids))
        self._time_s = 0.0
        self._now = log.at(choice.start_s)
        follows = np.delete(np.arange(len(choice.connected)), driven)
        self._end_s = min([choice.end_s, *choice.left_s[follows]])
        leaving, left_s = choice.connected[list(driven)], choice.left_s[list(driven)]
        self._drivers: Drivers | None = None
        if idm or driven:
            stays = choice.connected[follows]
            self._drivers = Drivers(log, choice.start_s, self._size, leaving, left_s, stays, idm=idm)
            self._now = self._drivers.now

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Go on by `dt_s`; commands are accelerations in m/s² of driven cars, by agent's name."""
        self._time_s = round(self._time_s + dt_s, 9)
        if self._drivers is None:
            self._now = self._log.at(self._start_s + self._time_s)
        else:
            asked = {self._track(name): acceleration_of(command) for name, command in (commands or {}).items()}
            self._drivers.step(dt_s, {k: wanted for k, wanted in asked.items() if k in self._drivers.commanded})
            self._now = self._drivers.now
        self._travelled_m[self._now.track] += dt_s * exact.norm(self._now.velocity)

    def car_ahead(self, name: str) -> CarState:
        """Return the motion of a driven car and the way ahead of it, as its driver knows them."""
        assert self._drivers is not None, "no car is driven"
        return self._drivers.car(self._track(name), self.map.traffic_side)

    def crashed(self) -> tuple[int, ...]:
        """Return the ids of crashed vehicles, which stay where they are, as obstacles."""
        return () if self._drivers is None else tuple((self._drivers.crashed + 1).tolist())

    def is_over_in(self, time_s: float) -> bool:
        """Return whether the log, or a connected car's way, will have ended after a time."""
        ended = self._start_s + self._time_s + time_s > self._end_s + 1e-6
        return ended or (self._drivers is not None and self._drivers.arrived)

    def _track(self, name: str) -> int:
        return int(self._connected[int(name.removeprefix("cav_"))])

    def actors(self) -> Actors:
        """Return the road users of this moment."""
        now, track = self._now, self._now.track
        size = self._size[track]
        middle = self._layout.on_ground(now.place[:, :2])
        middle[:, 2] += size[:, 2] / 2
        first, second = self._colors
        phase = np.mod(self._travelled_m / self._cycle_m + self._phase, 1.0)
        return Actors.trusted(
            Boxes3D.trusted(middle, size, now.heading.copy()),
            id=track + 1,
            velocity=now.velocity.copy(),
            label=self._log.label[track],
            model=self._model[track],
            color=first[track],
            accent=second[track],
            phase=phase[track],
        )

    def agents(self) -> dict[str, AgentBody]:
        """Return connected cars, then roadside units, then drones."""
        now, cars = self._now, self._connected
        row = np.searchsorted(now.track, cars)
        bodies = Cars(cars + 1, now.place[row, :2], now.heading[row], self._size[cars, 2])
        return self._layout.agents(bodies, (self._population.rsus, self._population.drones), self._time_s)
