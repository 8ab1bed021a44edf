"""Who drives: highway-env's IDM and MOBIL on the highway, with a look along the route in town, or a policy."""

from __future__ import annotations

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane
from highway_env.road.road import Road
from highway_env.utils import not_zero, wrap_to_pi
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import ROADS_AHEAD
from coopsim.world.traffic.engine.car_following import MERGE_M
from coopsim.world.traffic.engine.long_vehicles import BESIDE_M, LONG_M, SAME_WAY, swing_m
from coopsim.world.traffic.engine.neighbours import NEAR_M
from coopsim.world.traffic.engine.routes import draw_turn
from coopsim.world.traffic.engine.town_driving import EASY_BRAKING_M_S2, LOOK_AHEAD_M, STANDING_M_S, STEP_OUT_S
from coopsim.world.traffic.highway_reference.junction import Junction


class SizedVehicle(ControlledVehicle):  # type: ignore[misc]
    """A vehicle with the size of its model, that knows where it will turn.

    highway-env draws the next road when a lane ends. Here some roads are always planned ahead, so that others can
    know a turn before it begins.
    """

    route: list[tuple[str, str, int | None]] | None
    action: dict[str, float]
    axle_m: float
    turn_key: int
    turns = 0
    roads_ahead = ROADS_AHEAD

    def fit(self, length_m: float, width_m: float, axle_m: float, turn_key: int) -> None:
        """Take on a size, axles at a distance from the middle, and what decides the turns."""
        self.LENGTH, self.WIDTH, self.axle_m, self.turn_key = length_m, width_m, axle_m, turn_key
        self.diagonal = np.hypot(length_m, width_m)

    def step(self, dt: float) -> None:
        # highway-env has the axles at a vehicle's ends: for the bicycle it is as long as its wheelbase.
        length_m, self.LENGTH = self.LENGTH, 2 * self.axle_m
        super().step(dt)
        self.LENGTH = length_m

    def steering_control(self, target_lane_index: tuple[str, str, int]) -> float:
        """highway-env's; but who reaches beyond its axles leads the front one along the lane, not the middle."""
        if self.axle_m >= self.LENGTH / 2:
            return float(super().steering_control(target_lane_index))
        lane = self.road.network.get_lane(target_lane_index)
        along, aside = lane.local_coordinates(self.position + self.axle_m * self.direction)
        heading = np.arcsin(np.clip(-self.KP_LATERAL * aside / not_zero(self.speed), -1, 1))
        heading = lane.heading_at(along + self.speed * self.TAU_PURSUIT) + np.clip(heading, -np.pi / 4, np.pi / 4)
        angle = wrap_to_pi(heading - self.heading)
        return float(np.clip(angle, -self.MAX_STEERING_ANGLE, self.MAX_STEERING_ANGLE))

    def follow_road(self) -> None:
        self.plan_ahead()
        super().follow_road()

    def plan_ahead(self) -> None:
        """Draw turns until the route is long enough, or the road ends."""
        graph = self.road.network.graph
        if not self.route or self.route[0][:2] != self.target_lane_index[:2]:
            # Without the lane's number: MOBIL changes no lane where a route names one.
            self.route = [(*self.target_lane_index[:2], None)]
        while len(self.route) < self.roads_ahead:
            here = self.route[-1][1]
            ways = list(graph.get(here, {}))
            if not ways:
                return
            self.route.append((here, ways[draw_turn(self.turn_key, self.turns, len(ways))], None))
            self.turns += 1

    def choose_again(self, place: int) -> None:
        """Draw other turns from that place in the route on."""
        self.route = (self.route or [])[:place]
        self.plan_ahead()

    def upcoming(self) -> list[tuple[tuple[str, str], AbstractLane, float]]:
        """Roads of the route: index, lane, and distance (m) to its start, <= 0 for the one it is on."""
        self.plan_ahead()
        roads: list[tuple[tuple[str, str], AbstractLane, float]] = []
        distance_m = 0.0
        for start, end, number in self.route or ():
            if number is None:
                number = min(self.target_lane_index[2], len(self.road.network.graph[start][end]) - 1)
            lane = self.road.network.get_lane((start, end, number))
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
        taken = any(abs(self.lane_distance_to(other)) < MERGE_M for other in moving_in)
        return not taken and bool(super().mobil(lane_index))


class TownDriver(Driver):
    """A driver on short, bent roads: looks along the planned route, slows for bends, obeys the junction.

    highway-env's search for the vehicle in front measures along the current lane, straight on; at the end of a lane
    or in a bend it sees too little.
    """

    junction: Junction | None = None

    def act(self, action: dict[str, float] | str | None = None) -> None:
        self.leader, self.leader_m = self._tail_ahead(*self._look_ahead())
        super().act(action)
        if not self.crashed:
            free = self.acceleration(self, None)
            self.action["acceleration"] = float(np.clip(min(free, self._follow()), -self.ACC_MAX, self.ACC_MAX))

    def acceleration(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, rear_vehicle: Vehicle = None) -> float:
        """IDM on a free road, towards the speed that the bends ahead allow."""
        allowed = [
            np.sqrt(lane.speed_limit**2 + 2 * EASY_BRAKING_M_S2 * max(distance_m, 0.0))
            for _, lane, distance_m in self.upcoming()
        ]
        speed = min(self.target_speed, *allowed)
        return float(self.COMFORT_ACC_MAX * (1 - (max(self.speed, 0.0) / speed) ** self.DELTA))

    def _follow(self) -> float:
        """IDM behind what is in front: the leader, or the stop line."""
        accelerations = [np.inf]
        if self.leader is not None:
            accelerations.append(self._behind(self.leader, self.leader_m))
        line_m = None if self.junction is None else self.junction.line_m(self)
        if line_m is not None:
            accelerations.append(self._behind(_Line(self.road, self.position), line_m))
        return min(accelerations)

    def _behind(self, front: RoadObject, distance_m: float) -> float:
        gap = self.desired_gap(self, front)
        # A gap that is wanted to be negative (the leader is much faster) is no reason to brake.
        push = max(gap, 0.0) / max(distance_m, 0.1)
        return float(self.acceleration(self, None) - self.COMFORT_ACC_MAX * push**2)

    def _look_ahead(self) -> tuple[RoadObject | None, float]:
        """The nearest vehicle or person on the planned route, and the distance (m) between middles along it."""
        nearest: tuple[RoadObject | None, float] = (None, LOOK_AHEAD_M)
        near = [
            other
            for other in (*self.road.vehicles, *self.road.objects)
            if other is not self and np.abs(other.position - self.position).max() < LOOK_AHEAD_M
        ]
        for _, lane, start_m in self.upcoming():
            if start_m > nearest[1]:
                break
            for other in near:
                along, aside = lane.local_coordinates(other.position)
                distance_m = start_m + along
                if not (0 <= along <= lane.length and 0 < distance_m < nearest[1]):
                    continue
                if abs(aside) > lane.width_at(along) / 2 + NEAR_M:
                    continue
                if self._in_my_way(other, lane, along, aside):
                    nearest = (other, distance_m)
        return nearest

    def _tail_ahead(self, nearest: RoadObject | None, nearest_m: float) -> tuple[RoadObject | None, float]:
        """The nearest, or before it a long vehicle that turns off: its middle is off the route, its tail not yet."""
        for other in self.road.vehicles:
            tail = other.position - other.LENGTH / 2 * other.direction
            if other is self or other.LENGTH <= LONG_M or np.hypot(*(tail - self.position)) > nearest_m:
                continue
            for _, lane, start_m in self.upcoming():
                along, aside = lane.local_coordinates(tail)
                distance_m = start_m + along + other.LENGTH / 2
                if not (0 <= along <= lane.length and other.LENGTH / 2 < distance_m < nearest_m):
                    continue
                reach = (self.WIDTH + other.WIDTH) / 2 + BESIDE_M + self._swing_m(lane)
                middle_is_off = abs(lane.local_coordinates(other.position)[1]) >= reach
                same_way = np.cos(other.heading - lane.heading_at(along)) > SAME_WAY
                if abs(aside) < reach and middle_is_off and same_way:
                    nearest, nearest_m = other, distance_m
        return nearest, nearest_m

    def _swing_m(self, lane: AbstractLane) -> float:
        return swing_m(self.LENGTH, self.axle_m, lane.radius) if isinstance(lane, CircularLane) else 0.0

    def _in_my_way(self, other: RoadObject, lane: AbstractLane, along: float, aside: float) -> bool:
        """Whether to stay behind `other`, which is `along` and `aside` on `lane`.

        Vehicles if they go the same way (who crosses is the junction's business), are wrecks, or stand across with
        their ends in the lane; people if they are in the lane or about to step into it. Who swings out itself keeps
        behind those who go the same way on the outside, too.
        """
        reach = (self.WIDTH + other.WIDTH) / 2 + BESIDE_M
        heading = other.heading - lane.heading_at(along)
        if isinstance(other, Vehicle):
            same_way = np.cos(heading) > SAME_WAY
            if same_way:
                reach += self._swing_m(lane)
            if other.crashed or other.speed < STANDING_M_S:
                across = np.abs(np.cos(heading)) * other.WIDTH + np.abs(np.sin(heading)) * other.LENGTH
                return bool(abs(aside) < reach + (across - other.WIDTH) / 2)
            return bool(abs(aside) < reach and same_way)
        if isinstance(lane, CircularLane):  # the rear of a long vehicle goes inside the bend
            reach += self.LENGTH**2 / (8 * lane.radius)
        soon = aside + other.speed * np.sin(heading) * STEP_OUT_S
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


class Parked(SizedVehicle):
    """Stands where it is, and asks for nothing."""

    def act(self, action: dict[str, float] | str | None = None) -> None:
        self.action = {"steering": 0.0, "acceleration": 0.0}

    def upcoming(self) -> list[tuple[tuple[str, str], AbstractLane, float]]:
        return []
