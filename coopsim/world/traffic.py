"""Vehicles: highway-env's road, drivers (IDM and MOBIL) and bicycle kinematics, without its gym layer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

from coopsim.geometry.se3 import Floats
from coopsim.rng import stream
from coopsim.taxonomy import ObjectClass
from coopsim.world.junction import Junction
from coopsim.world.layout import Layout, Slot
from coopsim.world.scenario import Population
from coopsim.world.snapshot import Model

MANEUVERS = ("LANE_LEFT", "IDLE", "LANE_RIGHT", "FASTER", "SLOWER")
"""highway-env's discrete meta-actions, by number."""

_ROUTE_AHEAD = 5
_LOOK_AHEAD_M = 60.0
_EASY_BRAKING_M_S2 = 2.0
_STEP_OUT_S = 2.0  # people who will be in the lane by then are as good as in it
_STOP_MARGIN_M = 5.0  # IDM keeps five metres between bumpers; half of that is enough at a line
_PAINTS = np.array(
    [
        [200, 200, 205],
        [35, 37, 42],
        [245, 245, 242],
        [150, 24, 28],
        [28, 60, 130],
        [110, 115, 120],
        [36, 92, 60],
    ],
    dtype=np.uint8,
)


class _Sized(ControlledVehicle):  # type: ignore[misc]
    """A vehicle with the size of its model, that knows where it will turn.

    highway-env draws the next road when a lane ends. Here some roads are always planned ahead, so that others can
    know a turn before it begins.
    """

    route: list[tuple[str, str, int | None]] | None
    action: dict[str, float]
    actor_id: int
    model: int
    paint: np.ndarray[Any, np.dtype[np.uint8]]

    def fit(self, actor_id: int, index: int, model: Model, paint: np.ndarray[Any, np.dtype[np.uint8]]) -> None:
        """Take on a model's size and an identity."""
        self.actor_id, self.model, self.paint = actor_id, index, paint
        self.LENGTH, self.WIDTH = float(model.size_m[0]), float(model.size_m[1])
        self.diagonal = np.hypot(self.LENGTH, self.WIDTH)

    def follow_road(self) -> None:
        self.plan_ahead()
        super().follow_road()

    def plan_ahead(self) -> None:
        """Draw turns until the route is long enough, or the road ends."""
        graph = self.road.network.graph
        if not self.route or self.route[0][:2] != self.target_lane_index[:2]:
            self.route = [self.target_lane_index]
        while len(self.route) < _ROUTE_AHEAD:
            here = self.route[-1][1]
            ways = list(graph.get(here, {}))
            if not ways:
                return
            self.route.append((here, ways[self.road.np_random.integers(len(ways))], None))

    def upcoming(self) -> list[tuple[tuple[str, str], AbstractLane, float]]:
        """Roads of the route: index, lane, and distance (m) to its start, <= 0 for the one it is on."""
        self.plan_ahead()
        roads: list[tuple[tuple[str, str], AbstractLane, float]] = []
        distance_m = 0.0
        for start, end, number in self.route or ():
            lane = self.road.network.get_lane((start, end, number or 0))
            if not roads:
                distance_m = -lane.local_coordinates(self.position)[0]
            roads.append(((start, end), lane, distance_m))
            distance_m += lane.length
        return roads


class Driver(_Sized, IDMVehicle):  # type: ignore[misc]
    """Drives by itself: IDM and MOBIL, keeping the jam distance between bumpers whatever the lengths."""

    def desired_gap(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, projected: bool = True) -> float:
        gap: float = super().desired_gap(ego_vehicle, front_vehicle, projected)
        longer = (ego_vehicle.LENGTH + front_vehicle.LENGTH) / 2 - Vehicle.LENGTH
        return float(gap + max(0.0, longer))

    def step(self, dt: float) -> None:
        # IDM brakes on after the stop: in a queue highway-env's vehicles creep backwards, and steer while they do.
        acceleration = self.action.get("acceleration", 0.0)
        self.action = self.action | {"acceleration": max(acceleration, -max(self.speed, 0.0) / dt)}
        super().step(dt)


class TownDriver(Driver):
    """A driver on short, bent roads: looks along the planned route, slows for bends, obeys the junction.

    highway-env's search for the vehicle in front measures along the current lane, straight on; at the end of a lane
    or in a bend it sees too little.
    """

    junction: Junction

    def act(self, action: dict[str, float] | str | None = None) -> None:
        self.leader, self.leader_m = self._look_ahead()
        super().act(action)
        if not self.crashed:
            free = self.acceleration(self, None)
            self.action["acceleration"] = float(np.clip(min(free, self._follow()), -self.ACC_MAX, self.ACC_MAX))

    def acceleration(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, rear_vehicle: Vehicle = None) -> float:
        """IDM on a free road, towards the speed that the bends ahead allow."""
        allowed = [
            np.sqrt(lane.speed_limit**2 + 2 * _EASY_BRAKING_M_S2 * max(distance_m, 0.0))
            for _, lane, distance_m in self.upcoming()
        ]
        speed = min(self.target_speed, *allowed)
        return float(self.COMFORT_ACC_MAX * (1 - (max(self.speed, 0.0) / speed) ** self.DELTA))

    def _follow(self) -> float:
        """IDM behind what is in front: the leader, or the stop line."""
        accelerations = [np.inf]
        if self.leader is not None:
            accelerations.append(self._behind(self.leader, self.leader_m))
        if self.junction.must_stop(self):
            line = next((m for road, _, m in self.upcoming() if road[0].startswith("stop")), None)
            if line is not None and line > 0:
                accelerations.append(self._behind(_Line(self.road, self.position), line + _STOP_MARGIN_M))
        return min(accelerations)

    def _behind(self, front: RoadObject, distance_m: float) -> float:
        gap = self.desired_gap(self, front)
        # A gap that is wanted to be negative (the leader is much faster) is no reason to brake.
        push = max(gap, 0.0) / max(distance_m, 0.1)
        return float(self.acceleration(self, None) - self.COMFORT_ACC_MAX * push**2)

    def _look_ahead(self) -> tuple[RoadObject | None, float]:
        """The nearest vehicle or person on the planned route, and the distance (m) between middles along it."""
        nearest: tuple[RoadObject | None, float] = (None, _LOOK_AHEAD_M)
        near = [
            other
            for other in (*self.road.vehicles, *self.road.objects)
            if other is not self and np.abs(other.position - self.position).max() < _LOOK_AHEAD_M
        ]
        for _, lane, start_m in self.upcoming():
            if start_m > nearest[1]:
                break
            for other in near:
                along, aside = lane.local_coordinates(other.position)
                distance_m = start_m + along
                if not (0 <= along <= lane.length and 0 < distance_m < nearest[1]):
                    continue
                if self._in_my_way(other, lane, along, aside):
                    nearest = (other, distance_m)
        return nearest

    def _in_my_way(self, other: RoadObject, lane: AbstractLane, along: float, aside: float) -> bool:
        """Whether to stay behind `other`, which is `along` and `aside` on `lane`.

        Vehicles if they go the same way (who crosses is the junction's business) or are wrecks; people if they are
        in the lane or about to step into it.
        """
        reach = (self.WIDTH + other.WIDTH) / 2 + 0.4
        heading = other.heading - lane.heading_at(along)
        if isinstance(other, Vehicle):
            return bool(abs(aside) < reach and (other.crashed or np.cos(heading) > 0.5))
        soon = aside + other.speed * np.sin(heading) * _STEP_OUT_S
        return bool(min(aside, soon) < reach and max(aside, soon) > -reach)


class _Line(RoadObject):  # type: ignore[misc]
    """A stop line: stands still, and is as long as highway-env's usual vehicle."""

    LENGTH = Vehicle.LENGTH

    def __init__(self, road: Road, position: Floats) -> None:
        super().__init__(road, position)


class Chauffeured(_Sized, MDPVehicle):  # type: ignore[misc]
    """Driven by meta-actions: keeps lane and speed until told otherwise."""


class Traffic:
    """All vehicles of one episode.

    Args:
        layout: the place.
        population: how many.
        models: shapes to choose from.
        seed: the episode's.
        policy_control: connected cars do as they are told.
    """

    def __init__(
        self,
        layout: Layout,
        population: Population,
        models: Sequence[Model],
        seed: int,
        *,
        policy_control: bool = False,
    ) -> None:
        self._layout, self._models = layout, models
        self._rng = stream(seed, "traffic")
        self.road = Road(layout.network, np_random=stream(seed, "drivers"))
        self._junction = Junction(layout.network, layout.movements) if layout.movements else None
        self._next_id = 1
        slots = self._choose_slots(population)
        trucks = set(self._rng.permutation(len(slots))[: population.trucks].tolist())
        labels = [ObjectClass.TRUCK if k in trucks else ObjectClass.CAR for k in range(len(slots))]
        connected = self._connected(slots, labels, population.connected_cars)
        for k, (slot, label) in enumerate(zip(slots, labels, strict=True)):
            kind = Chauffeured if policy_control and k in connected else self._usual_driver()
            self.road.vehicles.append(self._spawn(kind, layout.slots[slot], label))
        self.connected: tuple[Vehicle, ...] = tuple(self.road.vehicles[k] for k in connected)

    @property
    def vehicles(self) -> list[Vehicle]:
        """All of them, connected ones included."""
        vehicles: list[Vehicle] = self.road.vehicles
        return vehicles

    def step(self, dt_s: float, maneuvers: Mapping[int, int]) -> None:
        """Advance by `dt_s`; `maneuvers` are meta-actions by the number of the connected car."""
        for number, maneuver in maneuvers.items():
            self.connected[number].act(MANEUVERS[maneuver])
        if self._junction is not None:
            commanded = [vehicle for vehicle in self.connected if isinstance(vehicle, Chauffeured)]
            self._junction.update(self.vehicles, commanded)
        self.road.act()
        self.road.step(dt_s)
        if self._layout.window_m is not None:
            self._renew(self._layout.window_m)

    def _usual_driver(self) -> type[Driver]:
        return Driver if self._junction is None else TownDriver

    def _choose_slots(self, population: Population) -> list[int]:
        """Slots of the vehicles, in the layout's order; those that make good connected cars are always taken."""
        first = list(self._layout.connected_first[: max(0, population.vehicles // 3)])
        rest = self._rng.permutation(np.setdiff1d(np.arange(len(self._layout.slots)), first))
        return sorted([*first, *rest[: population.vehicles - len(first)].tolist()])

    def _connected(self, slots: list[int], labels: list[ObjectClass], count: int) -> list[int]:
        """Which vehicles are connected: the first cars in the layout's order, so that one more changes no other."""
        place = {slot: k for k, slot in enumerate(slots)}
        order = [place[slot] for slot in self._layout.connected_first if slot in place]
        return [k for k in order if labels[k] is ObjectClass.CAR][:count]

    def _spawn(self, kind: type[_Sized], slot: Slot, label: ObjectClass, speed_share: float | None = None) -> _Sized:
        lane = self._layout.network.get_lane(slot.lane)
        along = slot.along_m + self._rng.uniform(-1.0, 1.0)
        share = self._rng.uniform(0.75, 1.0) if speed_share is None else speed_share
        speed = share * lane.speed_limit
        vehicle = kind(
            self.road,
            lane.position(along, 0.0),
            lane.heading_at(along),
            speed=speed,
            target_lane_index=slot.lane,
            target_speed=speed,
        )
        fitting = [index for index, model in enumerate(self._models) if model.label == label]
        index = fitting[self._rng.integers(len(fitting))]
        vehicle.fit(self._next_id, index, self._models[index], _PAINTS[self._rng.integers(len(_PAINTS))])
        self._next_id += 1
        if isinstance(vehicle, TownDriver) and self._junction is not None:
            vehicle.junction = self._junction
        return vehicle

    def _renew(self, window_m: float) -> None:
        """Replace vehicles that are far from every connected car by new ones at the window's edges."""
        anchors = [vehicle.position[0] for vehicle in self.connected] or [0.0]
        low, high = min(anchors) - window_m, max(anchors) + window_m
        for k, vehicle in enumerate(self.road.vehicles):
            if not low <= vehicle.position[0] <= high and vehicle not in self.connected:
                self.road.vehicles[k] = self._enter(vehicle, low, high)

    def _enter(self, gone: _Sized, low: float, high: float) -> _Sized:
        """A new vehicle for one that left, on the same carriageway, in a lane with room; else `gone` goes on.

        Whoever enters from behind is faster than the traffic in the window, whoever is met ahead is slower, so that
        both come in.
        """
        start, end, _ = gone.lane_index
        eastward = start.startswith("east")
        ahead = bool(self._rng.random() < 0.5) if eastward else True
        x = high - 5.0 if ahead else low + 5.0
        lanes = self._rng.permutation(len(self._layout.network.graph[start][end]))
        share = self._rng.uniform(0.7, 0.85) if ahead else self._rng.uniform(0.95, 1.05)
        label = ObjectClass(self._models[gone.model].label)
        for number in lanes.tolist():
            index = (start, end, number)
            lane = self._layout.network.get_lane(index)
            y = lane.position(0.0, 0.0)[1]
            near = [v for v in self.road.vehicles if abs(v.position[0] - x) < 30 and abs(v.position[1] - y) < 3]
            if not [v for v in near if v is not gone]:
                along = lane.local_coordinates(np.array([x, y]))[0]
                return self._spawn(Driver, Slot(index, float(along)), label, share)
        return gone
