"""Who drives: highway-env's IDM and MOBIL on the highway, with a look along the route in town, or a policy."""

from __future__ import annotations

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

from coopsim.geometry.se3 import Floats
from coopsim.world.junction import Junction
from coopsim.world.snapshot import Model

MANEUVERS = ("lane_left", "idle", "lane_right", "faster", "slower")
"""The discrete meta-actions, numbered as highway-env numbers them."""

_ROUTE_AHEAD = 5
_LOOK_AHEAD_M = 60.0
_EASY_BRAKING_M_S2 = 2.0
_MERGE_M = 30.0
_STEP_OUT_S = 2.0  # people who will be in the lane by then are as good as in it
_STOP_MARGIN_M = 5.0  # IDM keeps five metres between bumpers; half of that is enough at a line


class SizedVehicle(ControlledVehicle):  # type: ignore[misc]
    """A vehicle with the size of its model, that knows where it will turn.

    highway-env draws the next road when a lane ends. Here some roads are always planned ahead, so that others can
    know a turn before it begins.
    """

    route: list[tuple[str, str, int | None]] | None
    action: dict[str, float]
    actor_id: int
    model: int

    def fit(self, actor_id: int, index: int, model: Model) -> None:
        """Take on a model's size and an identity."""
        self.actor_id, self.model = actor_id, index
        self.LENGTH, self.WIDTH = float(model.size_m[0]), float(model.size_m[1])
        self.diagonal = np.hypot(self.LENGTH, self.WIDTH)

    @property
    def ground_velocity(self) -> Floats:
        """Of the body's middle, (2,) m/s: who steers also slips aside, which `velocity` leaves out."""
        course = self.heading + np.arctan(np.tan(self.action["steering"]) / 2)
        velocity: Floats = np.array([np.cos(course), np.sin(course)]) * self.speed
        return velocity

    def follow_road(self) -> None:
        self.plan_ahead()
        super().follow_road()

    def plan_ahead(self) -> None:
        """Draw turns until the route is long enough, or the road ends."""
        graph = self.road.network.graph
        if not self.route or self.route[0][:2] != self.target_lane_index[:2]:
            # Without the lane's number: MOBIL changes no lane where a route names one.
            self.route = [(*self.target_lane_index[:2], None)]
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


class Driver(SizedVehicle, IDMVehicle):  # type: ignore[misc]
    """Drives by itself: IDM, keeping the jam distance between bumpers whatever the lengths."""

    def desired_gap(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, projected: bool = True) -> float:
        gap: float = super().desired_gap(ego_vehicle, front_vehicle, projected)
        longer = (ego_vehicle.LENGTH + front_vehicle.LENGTH) / 2 - Vehicle.LENGTH
        return float(gap + max(0.0, longer))

    def step(self, dt: float) -> None:
        # IDM brakes on after the stop: in a queue highway-env's vehicles creep backwards, and steer while they do.
        acceleration = self.action.get("acceleration", 0.0)
        self.action = self.action | {"acceleration": max(acceleration, -max(self.speed, 0.0) / dt)}
        super().step(dt)


class HighwayDriver(Driver):
    """A driver who changes lanes by MOBIL, unless somebody else is about to move into the same gap."""

    TIME_WANTED = 1.0  # s; highway-env's 1.5 would fill the lanes, and nobody could pass
    KP_LATERAL = 0.5  # 1/s; with highway-env's 1.67 a car turns by 15 degrees at 25 m/s, and back, in a second

    def mobil(self, lane_index: tuple[str, str, int]) -> bool:
        moving_in = (
            other
            for other in self.road.vehicles
            if other is not self and other.target_lane_index == lane_index != other.lane_index
        )
        taken = any(abs(self.lane_distance_to(other)) < _MERGE_M for other in moving_in)
        return not taken and bool(super().mobil(lane_index))


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


class Chauffeured(SizedVehicle, MDPVehicle):  # type: ignore[misc]
    """Driven by meta-actions: keeps lane and speed until told otherwise."""

    def choose_among(self, speeds_m_s: tuple[float, ...]) -> None:
        """Set the speeds that "faster" and "slower" step through; they are evenly spaced."""
        self.target_speeds = np.array(speeds_m_s)
        self.speed_index = self.speed_to_index(self.speed)
        self.target_speed = self.index_to_speed(self.speed_index)
