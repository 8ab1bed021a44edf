"""The world of an episode in which SUMO drives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from coopsim.data.live.engine import SumoEngine, Users
from coopsim.data.live.lights import SumoLights
from coopsim.data.live.way_ahead import way_ahead
from coopsim.data.logs.play.shapes import fitted_models
from coopsim.geometry import exact
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.rng import uniform_numbers
from coopsim.types.driving import CarState, Command, acceleration_of
from coopsim.world.models.paint import draw_colors
from coopsim.world.places.layout import Cars
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody, RoadMap, StaticPart

MOST_SHOWN = 1000
"""Most road users in a place; of more, the farthest from its middle are left out."""

_LOOKS = 16
"""Shapes to choose from for the road users of a type."""


class SumoWorld:
    """Road users of a run of SUMO that has come to the episode's start; see `WorldSource`.

    Attributes:
        left_s: time of the episode at which the first connected car arrived or left the place; None: all are there.

    Args:
        engine: the run.
        step_s: its step.
        cars: names of the connected cars, in the agents' order.
        scenario: the surroundings, roadside units and drones.
        middle: (2,) m, the world's origin in the network's plane.
        radius_m: road users beyond are not in the world.
        seed: the episode's: models and colours.
    """

    conflict_ids: tuple[int, ...] = ()

    def __init__(
        self,
        engine: SumoEngine,
        step_s: float,
        cars: Sequence[str],
        scenario: Scenario,
        middle: Floats,
        radius_m: float,
        seed: int,
    ) -> None:
        self._engine, self._step_s, self._cars = engine, step_s, tuple(cars)
        self._middle, self._radius_m, self._seed = middle, radius_m, seed
        kinds = np.repeat(np.maximum(engine.label, 0), _LOOKS)
        self.models, model = fitted_models(kinds, np.repeat(engine.size, _LOOKS, axis=0), scenario.models, seed)
        self._models_of_kind = model.reshape(-1, _LOOKS)
        self._cycles_m = np.array([each.cycle_m for each in self.models])
        self._sizes = np.array([each.size_m for each in self.models])
        self._labels = np.array([each.label for each in self.models])
        self._dirty = scenario.detail != "plain"
        self.static: tuple[StaticPart, ...] = scenario.static
        self._layout, self._population = scenario.layout, scenario.population
        self._lights = SumoLights(engine.sumo, scenario.layout, middle)
        self.map: RoadMap = scenario.road_map
        self._number = {name: k for k, name in enumerate(self._cars, start=1)}  # the ids of actors
        self._travelled_m = np.zeros(len(self._cars) + 1)
        self._crashed: set[str] = set()
        self._known: dict[str, CarState] = {}
        self.left_s: float | None = None
        self._begin_s, self._steps = engine.time_s, 0
        self._now: Users
        self._look()

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Let SUMO go on; cars with a command, m/s², take their speed from it."""
        asked = {self._name(agent): acceleration_of(command) for agent, command in (commands or {}).items()}
        for _ in range(round(dt_s / self._step_s)):
            self._engine.drive(asked, self._step_s, self._crashed)
            self._steps += 1
            self._engine.go_on(round(self._begin_s + self._time_s, 3))
            for pair in self._engine.touching():
                if not (self._crashed | asked.keys()).isdisjoint(pair):
                    self._crashed.update(pair)
        self._look()
        self._travelled_m[self._id] += dt_s * exact.norm(self._now.velocity)

    @property
    def _time_s(self) -> float:
        """Time of the episode."""
        return self._steps * self._step_s

    def _name(self, agent: str) -> str:
        return self._cars[int(agent.removeprefix("cav_"))]

    def _look(self) -> None:
        """Take the road users of the place as they are now, and the lights."""
        users = self._engine.users()
        users = replace(users, place=users.place - self._middle)
        lost = [name for name in self._cars if name not in users.names]
        if lost:  # one that has arrived is where it would be now, in the episode's last frame
            before = self._now[np.array([self._now.names.index(name) for name in lost])]
            users = users.joined(replace(before, place=before.place + self._step_s * before.velocity))
        apart_m = exact.norm(users.place)
        cars = [users.names.index(name) for name in self._cars]
        if self.left_s is None and (lost or apart_m[cars].max(initial=0.0) > self._radius_m):
            self.left_s = self._time_s
        apart_m[cars] = 0.0  # they are there in any case
        nearest = np.argsort(apart_m, kind="stable")[:MOST_SHOWN]
        self._now = users[np.sort(nearest[apart_m[nearest] <= self._radius_m])]
        for name in self._now.names:
            self._number.setdefault(name, len(self._number) + 1)
        self._id = np.array([self._number[name] for name in self._now.names], np.int64)
        self._travelled_m = np.pad(self._travelled_m, (0, len(self._number) + 1 - len(self._travelled_m)))
        lights = self._lights.letters()
        if lights != self.map.lights:
            self.map = replace(self.map, lights=lights)

    def actors(self) -> Actors:
        """Return the road users of this moment."""
        now, identity = self._now, self._id
        look, start = (uniform_numbers(self._seed, purpose, identity, 1)[:, 0] for purpose in ("model", "phase"))
        model = self._models_of_kind[now.kind, (look * _LOOKS).astype(np.int64)]
        label, size = self._labels[model], self._sizes[model]
        color, accent = draw_colors(self._seed, identity, label, dirty=self._dirty)
        middle = self._layout.on_ground(now.place)
        middle[:, 2] += size[:, 2] / 2
        return Actors.trusted(
            Boxes3D.trusted(middle, size, wrap_angle(now.heading)),
            id=identity,
            velocity=now.velocity.copy(),
            label=label,
            model=model,
            color=color,
            accent=accent,
            phase=np.mod(self._travelled_m[identity] / self._cycles_m[model] + start, 1.0),
        )

    def agents(self) -> dict[str, AgentBody]:
        """Return connected cars, then roadside units, then drones."""
        now = self._now
        row = [now.names.index(name) for name in self._cars]
        identity = np.array([self._number[name] for name in self._cars], np.int64)
        cars = Cars(identity, now.place[row], now.heading[row], self._engine.size[now.kind[row], 2])
        return self._layout.agents(cars, (self._population.rsus, self._population.drones), self._time_s)

    def car_ahead(self, agent: str) -> CarState:
        """Return the motion of a connected car and the way ahead of it; of one that has arrived, the last."""
        name, vehicle = self._name(agent), self._engine.sumo.vehicle
        if name in vehicle.getIDList():
            row = self._now.names.index(name)
            place = self._now.place[row] + self._middle
            self._known[name] = CarState(
                vehicle.getSpeed(name),
                vehicle.getAcceleration(name),
                vehicle.getLength(name),
                vehicle.getWidth(name),
                name in self._crashed,
                way_ahead(self._engine.sumo, name, place, float(self._now.heading[row])),
                self.map.traffic_side,
            )
        return self._known[name]

    def crashed(self) -> tuple[int, ...]:
        """Return the ids of connected cars that crashed while agents drove them, and of whom they touched."""
        return tuple(sorted(self._number[name] for name in self._crashed if name in self._number))

    def is_over_in(self, time_s: float) -> bool:
        """Return whether a connected car arrived or left the place, and none is to be seen after a time."""
        return self.left_s is not None and self._time_s + time_s > self.left_s + 1e-6
