"""The world: everything there is to sense, stepped together."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.rng import chances
from coopsim.taxonomy import ObjectClass
from coopsim.types import Ints
from coopsim.world.appearance import Colors, draw_colors
from coopsim.world.models import make_models
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody, Model, RoadMap, StaticPart
from coopsim.world.traffic import Traffic
from coopsim.world.vulnerable import Pedestrians

LONGEST_STEP_S = 0.1
"""Drivers who react once in half a second crash: IDM and the lane keeping are made for tenths."""

PEDESTRIAN_ID = 1_000_000_000
"""Ids of people start here, vehicles' at 1: how many there are of one kind does not renumber the other."""


class World:
    """One episode's world.

    Args:
        scenario: place and population.
        seed: decides everything that happens.
        policy_control: connected cars do as `step` tells them, instead of driving by themselves.
    """

    def __init__(self, scenario: Scenario, seed: int, *, policy_control: bool = False) -> None:
        layout, population = scenario.layout, scenario.population
        self._seed, self._drawn_key = seed, b"none yet"
        self._drawn: tuple[Colors, Colors, Floats]
        self.models: tuple[Model, ...] = make_models()
        self.static: tuple[StaticPart, ...] = layout.static
        self.map: RoadMap = layout.road_map
        self._policy_control = policy_control
        self._traffic = Traffic(layout, population, self.models, seed, policy_control=policy_control)
        people = [k for k, model in enumerate(self.models) if model.label == ObjectClass.PEDESTRIAN]
        self._people = Pedestrians(layout.footways, population.pedestrians, people, self._traffic.road, seed)
        self._units = layout.rsus[: population.rsus]
        self._unit_height_m = layout.rsu_height_m

    def step(self, dt_s: float, maneuvers: Mapping[str, int] | None = None) -> None:
        """Advance by `dt_s`, in equal parts that are short enough for drivers to react.

        Args:
            dt_s: time step.
            maneuvers: numbers into `coopsim.world.drivers.MANEUVERS` by agent's name, under policy control.
        """
        told = (maneuvers or {}) if self._policy_control else {}
        numbered = {int(name.removeprefix("cav_")): told[name] for name in told}
        parts = max(1, math.ceil(dt_s / LONGEST_STEP_S - 1e-9))
        for part in range(parts):
            self._traffic.step(dt_s / parts, {} if part else numbered)
            self._people.step(dt_s / parts)

    def actors(self) -> Actors:
        """All vehicles, connected ones included, then all people; in the world frame."""
        vehicles, people = self._traffic.vehicles, self._people
        model = np.array([*(vehicle.model for vehicle in vehicles), *people.model], dtype=np.int64)
        size = np.array([shape.size_m for shape in self.models])[model]
        ground = np.array([*(vehicle.position for vehicle in vehicles), *people.position]).reshape(-1, 2)
        yaw = np.array([*(vehicle.heading for vehicle in vehicles), *people.yaw])
        label = np.array([shape.label for shape in self.models])[model]
        velocity = np.array([*(vehicle.ground_velocity for vehicle in vehicles), *people.velocity]).reshape(-1, 2)
        identity = np.array([*(vehicle.actor_id for vehicle in vehicles), *(PEDESTRIAN_ID + np.arange(len(people)))])
        boxes = Boxes3D(np.column_stack([ground, size[:, 2] / 2]), size, wrap_angle(yaw))
        travelled_m = np.concatenate([np.zeros(len(vehicles)), people.travelled_m])
        cycles = travelled_m / np.array([shape.cycle_m for shape in self.models])[model]
        color, accent, start = self._drawn_for(identity, label)
        return Actors(identity, boxes, velocity, label, model, color, accent, np.mod(cycles + start, 1.0))

    def _drawn_for(self, identity: Ints, label: Ints) -> tuple[Colors, Colors, Floats]:
        """First and second colours, and where in their cycle actors start: nobody keeps step with anybody."""
        key = identity.tobytes()
        if key != self._drawn_key:  # mostly the same actors as in the last frame
            start = chances(self._seed, "phase", identity, 1)[:, 0]
            self._drawn_key, self._drawn = key, (*draw_colors(self._seed, identity, label), start)
        return self._drawn

    def agents(self) -> dict[str, AgentBody]:
        """Connected cars, then roadside units."""
        bodies: dict[str, AgentBody] = {}
        for k, car in enumerate(self._traffic.connected):
            pose = SE3.from_xyz_yaw([*car.position, 0.0], car.heading)
            height_m = float(self.models[car.model].size_m[2])
            bodies[f"cav_{k}"] = AgentBody(f"cav_{k}", "cav", car.actor_id, pose, height_m)
        for k, unit in enumerate(self._units):
            bodies[f"rsu_{k}"] = AgentBody(f"rsu_{k}", "rsu", None, unit, self._unit_height_m)
        return bodies

    def crashed(self) -> tuple[int, ...]:
        """Ids of vehicles that have crashed; they stay where they are, as obstacles."""
        return tuple(vehicle.actor_id for vehicle in self._traffic.vehicles if vehicle.crashed)
