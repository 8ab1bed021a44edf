"""Traffic by highway-env's own classes (`traffic="highway-env"`): slow, and a check of the array engine.

Drivers follow its IDM and MOBIL on the highway, and in town the rules of `coopsim.world.traffic.rules`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from highway_env.road import lane as highway_lanes
from highway_env.road import road as highway_roads
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.driving import Command, Route
from coopsim.types.messages import MANEUVERS
from coopsim.world.places.layout import CLEARANCE_M, ROADS_AHEAD
from coopsim.world.places.road_network import CircularLane, Road, RoadNetwork, StraightLane
from coopsim.world.places.signals import Signal
from coopsim.world.traffic import rules
from coopsim.world.traffic.asked import GRANTED
from coopsim.world.traffic.fleet import CHAUFFEURED, HIGHWAY, PARKED, TOWN, Fleet
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.lights import Lights
from coopsim.world.traffic.movements import movements_of
from coopsim.world.traffic.right_of_way import grant


class SizedVehicle(ControlledVehicle):  # type: ignore[misc]
    """A vehicle with the size of its model and a planned route.

    highway-env draws the next road when a lane ends. Here some roads are always planned ahead, so that others can know
    a turn before it begins.
    """

    route: list[tuple[str, str, int | None]] | None
    action: dict[str, float]
    axle_m: float
    turn_key: int
    turns = 0
    roads_ahead = ROADS_AHEAD

    def fit(self, length_m: float, width_m: float, axle_m: float, turn_key: int) -> None:
        """Set the size, the distance of the axles from the middle, and the key that decides the turns."""
        self.LENGTH, self.WIDTH, self.axle_m, self.turn_key = length_m, width_m, axle_m, turn_key
        self.diagonal = np.hypot(length_m, width_m)

    def step(self, dt: float) -> None:
        # highway-env puts the axles at a vehicle's ends: for its bicycle model the length is the wheelbase.
        length_m, self.LENGTH = self.LENGTH, 2 * self.axle_m
        super().step(dt)
        self.LENGTH = length_m

    def steering_control(self, target_lane_index: tuple[str, str, int]) -> float:
        """Return highway-env's steering, but lead the front axle along the lane if the vehicle extends beyond it."""
        if self.axle_m >= self.LENGTH / 2:
            return float(super().steering_control(target_lane_index))
        lane = self.road.network.get_lane(target_lane_index)
        along, aside = lane.local_coordinates(self.position + self.axle_m * self.direction)
        ahead = lane.heading_at(along + self.speed * self.TAU_PURSUIT)
        return float(rules.steer_front_axle(aside, ahead, self.heading, self.speed, self.KP_LATERAL))

    def follow_road(self) -> None:
        self.plan_ahead()
        super().follow_road()

    def plan_ahead(self) -> None:
        """Draw turns until the route is long enough, or the road ends."""
        graph = self.road.network.graph
        if not self.route or self.route[0][:2] != self.target_lane_index[:2]:
            # Without a lane's number: where a route has one, MOBIL changes no lane.
            self.route = [(*self.target_lane_index[:2], None)]
        while len(self.route) < self.roads_ahead:
            here = self.route[-1][1]
            ways = list(graph.get(here, {}))
            if not ways:
                return
            self.route.append((here, ways[rules.draw_turn(self.turn_key, self.turns, len(ways))], None))
            self.turns += 1

    def upcoming(self) -> list[tuple[tuple[str, str], highway_lanes.AbstractLane, float]]:
        """Return the route's roads: index, lane, and distance (m) to its start, <= 0 for the present one."""
        self.plan_ahead()
        roads: list[tuple[tuple[str, str], highway_lanes.AbstractLane, float]] = []
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
    """A driver by IDM, with the jam distance between bumpers whatever the lengths."""

    def desired_gap(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, projected: bool = True) -> float:
        gap: float = super().desired_gap(ego_vehicle, front_vehicle, projected)
        return gap + float(rules.extra_gap(ego_vehicle.LENGTH, front_vehicle.LENGTH))

    def step(self, dt: float) -> None:
        acceleration = rules.without_reversing(self.action.get("acceleration", 0.0), self.speed, dt)
        self.action = self.action | {"acceleration": acceleration}
        super().step(dt)


class HighwayDriver(Driver):
    """A driver that changes lanes by MOBIL, unless another vehicle is about to enter the same gap."""

    TIME_WANTED = 1.0  # s; highway-env's 1.5 would fill the lanes, and leave no gap to pass
    KP_LATERAL = 0.5  # 1/s; with highway-env's 1.67 a car turns by 15 degrees at 25 m/s, and back, in a second

    def mobil(self, lane_index: tuple[str, str, int]) -> bool:
        moving_in = (
            other
            for other in self.road.vehicles
            if other is not self and other.target_lane_index == lane_index != other.lane_index
        )
        taken = any(abs(self.lane_distance_to(other)) < rules.MERGE_M for other in moving_in)
        return not taken and bool(super().mobil(lane_index))


class TownDriver(Driver):
    """A driver on short, bent roads that looks along its route, slows for bends, and obeys the junction.

    highway-env's search for the vehicle in front measures along the current lane, straight on; at the end of a lane or
    in a bend it sees too little.
    """

    movements: frozenset[Road] = frozenset()
    waits = False
    """Whether the vehicle has asked for the next of `movements`, and has no grant."""

    def act(self, action: dict[str, float] | str | None = None) -> None:
        self.leader, self.leader_m = self._tail_ahead(*self._nearest_on_route())
        super().act(action)
        if not self.crashed:
            free = self.acceleration(self, None)
            self.action["acceleration"] = float(np.clip(min(free, self._follow()), -self.ACC_MAX, self.ACC_MAX))

    def acceleration(self, ego_vehicle: Vehicle, front_vehicle: Vehicle = None, rear_vehicle: Vehicle = None) -> float:
        """Return IDM's acceleration on a free road, towards the speed that the bends ahead allow."""
        allowed = [rules.approach_speed(lane.speed_limit, distance_m) for _, lane, distance_m in self.upcoming()]
        speed = min(self.target_speed, *allowed)
        return float(self.COMFORT_ACC_MAX * (1 - (max(self.speed, 0.0) / speed) ** self.DELTA))

    def _follow(self) -> float:
        """Return IDM's acceleration behind the leader or the stop line."""
        accelerations = [np.inf]
        if self.leader is not None:
            accelerations.append(self._behind(self.leader, self.leader_m))
        line_m = next((distance_m for road, _, distance_m in self.upcoming() if road in self.movements), 0.0)
        if self.waits and line_m > 0:
            accelerations.append(self._behind(_Line(self.road, self.position), line_m))
        return min(accelerations)

    def _behind(self, front: RoadObject, distance_m: float) -> float:
        return float(self.acceleration(self, None) - rules.interaction(self.desired_gap(self, front), distance_m))

    def _nearest_on_route(self) -> tuple[RoadObject | None, float]:
        """Return the nearest obstacle on the planned route, and the distance (m) between middles along it."""
        nearest: tuple[RoadObject | None, float] = (None, rules.LOOK_AHEAD_M)
        near = [
            other
            for other in (*self.road.vehicles, *self.road.objects)
            if other is not self and np.abs(other.position - self.position).max() < rules.LOOK_AHEAD_M
        ]
        for _, lane, start_m in self.upcoming():
            if start_m > nearest[1]:
                break
            for other in near:
                along, aside = lane.local_coordinates(other.position)
                distance_m = start_m + along
                if not (0 <= along <= lane.length and 0 < distance_m < nearest[1]):
                    continue
                if abs(aside) > lane.width_at(along) / 2 + rules.NEAR_M:
                    continue
                if self._is_in_way(other, lane, along, aside):
                    nearest = (other, distance_m)
        return nearest

    def _tail_ahead(self, nearest: RoadObject | None, nearest_m: float) -> tuple[RoadObject | None, float]:
        """Return `nearest`, or a long vehicle before it that turns off and still has its tail on the route."""
        for other in self.road.vehicles:
            tail = other.position - other.LENGTH / 2 * other.direction
            if other is self or other.LENGTH <= rules.LONG_M or np.hypot(*(tail - self.position)) > nearest_m:
                continue
            for _, lane, start_m in self.upcoming():
                along, aside = lane.local_coordinates(tail)
                distance_m = start_m + along + other.LENGTH / 2
                if not (0 <= along <= lane.length and other.LENGTH / 2 < distance_m < nearest_m):
                    continue
                reach_m = rules.passing_distance(self.WIDTH, other.WIDTH) + self._swing_m(lane)
                middle_aside = lane.local_coordinates(other.position)[1]
                if rules.is_tail_in_way(aside, other.heading - lane.heading_at(along), middle_aside, reach_m):
                    nearest, nearest_m = other, distance_m
        return nearest, nearest_m

    def _swing_m(self, lane: highway_lanes.AbstractLane) -> float:
        if not isinstance(lane, highway_lanes.CircularLane):
            return 0.0
        return float(rules.swing_m(self.LENGTH, self.axle_m, lane.radius))

    def _is_in_way(self, other: RoadObject, lane: highway_lanes.AbstractLane, along: float, aside: float) -> bool:
        reach_m = rules.passing_distance(self.WIDTH, other.WIDTH)
        angle = other.heading - lane.heading_at(along)
        if isinstance(other, Vehicle):
            stands = bool(other.crashed or other.speed < rules.STANDING_M_S)
            return rules.is_vehicle_in_way(
                aside, angle, other.LENGTH, other.WIDTH, stands, reach_m, self._swing_m(lane)
            )
        if isinstance(lane, highway_lanes.CircularLane):
            reach_m += rules.cut_inside_m(self.LENGTH, lane.radius)
        return rules.is_person_in_way(aside, angle, other.speed, reach_m)


class _Line(RoadObject):  # type: ignore[misc]
    """A stop line: stands still, and is as long as highway-env's usual vehicle."""

    LENGTH = Vehicle.LENGTH

    def __init__(self, road: highway_roads.Road, position: Floats) -> None:
        super().__init__(road, position)


class Chauffeured(SizedVehicle, MDPVehicle):  # type: ignore[misc]
    """A vehicle driven by meta-actions, which keeps lane and speed without one."""

    def choose_among(self, speeds_m_s: tuple[float, ...]) -> None:
        """Set the speeds that "faster" and "slower" step through; they are evenly spaced."""
        self.target_speeds = np.array(speeds_m_s)
        self.speed_index = self.speed_to_index(self.speed)
        self.target_speed = self.index_to_speed(self.speed_index)


class Parked(SizedVehicle):
    """A vehicle that stands."""

    def act(self, action: dict[str, float] | str | None = None) -> None:
        self.action = {"steering": 0.0, "acceleration": 0.0}


_DRIVERS: dict[int, type[SizedVehicle]] = {
    HIGHWAY: HighwayDriver,
    TOWN: TownDriver,
    CHAUFFEURED: Chauffeured,
    PARKED: Parked,
}


class _Body(RoadObject):  # type: ignore[misc]
    """A person as an obstacle that moves; a car that touches it is crashed."""

    def __init__(self, road: highway_roads.Road, row: NDArray[Any]) -> None:
        super().__init__(road, (row["x"], row["y"]))
        self.LENGTH, self.WIDTH = float(row["length"]), float(row["width"])
        self.diagonal = np.hypot(self.LENGTH, self.WIDTH)


class ReferenceEngine:
    """Steps a fleet as `ArrayEngine` does, with the same arguments."""

    def __init__(
        self,
        network: NumberedNetwork,
        movements: Sequence[Road] = (),
        speeds_m_s: Sequence[float] = (),
        priority: Sequence[Road] = (),
        clearance_m: float = CLEARANCE_M,
        yields: Mapping[Road, Sequence[Road]] | None = None,
        signals: Sequence[Signal] = (),
    ) -> None:
        if signals:
            raise InvalidValueError('traffic must be "arrays" where there are traffic lights')
        self.lights: Lights | None = None
        self._network, self._speeds = network, tuple(speeds_m_s)
        self._road = highway_roads.Road(_as_highway_env(network.source))
        self._movements, self._over_junctions = (
            movements_of(network, movements, priority, clearance_m, yields),
            frozenset(movements),
        )
        self._ids: list[int] = []

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, commands: Mapping[int, Command]) -> None:
        """Advance a fleet by `dt_s`; see `ArrayEngine.step`. Accelerations are not supported."""
        self._read(fleet, people)
        vehicles: list[SizedVehicle] = self._road.vehicles
        for row, command in commands.items():
            assert isinstance(command, int), "maneuvers alone are supported"
            vehicles[row].act(MANEUVERS[command].upper())
        if self._over_junctions:
            self._grant(fleet)
        self._road.act()
        self._road.step(dt_s)
        self._write(fleet)

    def way_ahead(self, fleet: Fleet, row: int) -> Route:
        """Raise `InvalidValueError`: highway-env's vehicles have no way of coopsim's."""
        raise InvalidValueError('control must be "traffic" or "policy" with traffic="highway-env"')

    def _read(self, fleet: Fleet, people: NDArray[Any]) -> None:
        """Take over new vehicles, target speeds, and people."""
        for k, row in enumerate(fleet.rows):
            if k == len(self._ids):
                self._ids.append(0)
                self._road.vehicles.append(None)
            if row["id"] != self._ids[k]:
                self._ids[k], self._road.vehicles[k] = row["id"], self._vehicle(row, fleet.routes[k])
            if isinstance(self._road.vehicles[k], Driver):
                self._road.vehicles[k].target_speed = row["target_speed"]
        if len(self._road.objects) != len(people):
            self._road.objects = [_Body(self._road, row) for row in people]
        for body, row in zip(self._road.objects, people, strict=True):
            body.position = np.array([row["x"], row["y"]])
            body.heading, body.speed = row["heading"], row["speed"]

    def _grant(self, fleet: Fleet) -> None:
        """Renew the right of way, which may also change routes."""
        number = self._network.road_number
        for row, route, vehicle in zip(fleet.rows, fleet.routes, self._road.vehicles, strict=True):
            planned = [number[start, end] for start, end, _ in vehicle.route or ()]
            route[: len(planned), 0], route[: len(planned), 1] = planned, -1
            row["route_length"], row["turns"] = len(planned), vehicle.turns
            row["target_lane"] = self._network.lane_number[vehicle.target_lane_index]
        grant(self._network.arrays, fleet.rows, fleet.routes, self._movements)
        for row, route, vehicle in zip(fleet.rows, fleet.routes, self._road.vehicles, strict=True):
            vehicle.route, vehicle.turns = self._named(route[: row["route_length"]]), int(row["turns"])
            vehicle.waits = row["ticket"] > GRANTED

    def _named(self, route: Ints) -> list[tuple[str, str, int | None]]:
        return [(*self._network.roads[road], None) for road, _ in route]

    def _write(self, fleet: Fleet) -> None:
        for row, vehicle in zip(fleet.rows, self._road.vehicles, strict=True):
            row["x"], row["y"] = vehicle.position
            row["heading"], row["speed"], row["crashed"] = vehicle.heading, vehicle.speed, vehicle.crashed
            row["steering"], row["acceleration"] = vehicle.action["steering"], vehicle.action["acceleration"]
            row["lane"] = self._network.lane_number[vehicle.lane_index]
            row["target_lane"] = self._network.lane_number[vehicle.target_lane_index]

    def _vehicle(self, row: NDArray[Any], route: Ints) -> SizedVehicle:
        vehicle = _DRIVERS[int(row["driver"])](
            self._road,
            (row["x"], row["y"]),
            row["heading"],
            speed=row["speed"],
            target_lane_index=self._network.lane_index[row["target_lane"]],
            target_speed=row["target_speed"],
        )
        vehicle.fit(float(row["length"]), float(row["width"]), float(row["axle_m"]), int(row["turn_key"]))
        vehicle.roads_ahead = len(route)
        vehicle.route = self._named(route[: row["route_length"]])
        if isinstance(vehicle, Driver):
            vehicle.TIME_WANTED = float(row["time_wanted"])
        if isinstance(vehicle, TownDriver):
            vehicle.movements = self._over_junctions
        if isinstance(vehicle, Chauffeured):
            vehicle.choose_among(self._speeds)
        return vehicle


def _as_highway_env(network: RoadNetwork) -> highway_roads.RoadNetwork:
    """Return the same roads as highway-env's objects."""
    converted = highway_roads.RoadNetwork()
    for (start, end, _), lane in network.lanes.items():
        usual = {"width": lane.width, "speed_limit": lane.speed_limit, "forbidden": lane.forbidden}
        if isinstance(lane, StraightLane):
            converted.add_lane(start, end, highway_lanes.StraightLane(lane.start, lane.end, **usual))
        elif isinstance(lane, CircularLane):
            # highway-env looks at y from above: its clockwise is our left turn.
            arc = (lane.center, lane.radius, lane.start_phase, lane.end_phase, lane.turn > 0)
            converted.add_lane(start, end, highway_lanes.CircularLane(*arc, **usual))
        else:
            raise InvalidValueError(
                f'traffic must be "arrays" where lanes are curved, as that from {start!r} to {end!r}'
            )
    return converted
