"""The array engine: one step of all vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.types.driving import Command, Route, approached
from coopsim.types.messages import MANEUVERS
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import Road
from coopsim.world.places.signals import Signal
from coopsim.world.traffic.asked import count_reds, stop_line_m
from coopsim.world.traffic.drivers import ACC_MAX, change_lane, drive, follow, is_reachable, nearest_on_route, stop_at
from coopsim.world.traffic.fleet import CHAUFFEURED, PARKED, PEDALLED, STEERED, TOWN, UNYIELDING, Fleet, bodies_of
from coopsim.world.traffic.lanes import LaneArrays, NumberedNetwork
from coopsim.world.traffic.lights import Lights
from coopsim.world.traffic.motion import SPEED_GAIN_1_S, collide, move, steer
from coopsim.world.traffic.movements import Movements, movements_of
from coopsim.world.traffic.neighbours import Scene, list_along_lanes
from coopsim.world.traffic.right_of_way import grant
from coopsim.world.traffic.routes import end_of_route, follow_road, plan_ahead
from coopsim.world.traffic.steered import actuate
from coopsim.world.traffic.way_ahead import way_ahead

_LANE_LEFT, _LANE_RIGHT, _FASTER, _SLOWER = (
    MANEUVERS.index(name) for name in ("lane_left", "lane_right", "faster", "slower")
)


class ArrayEngine:
    """The default engine: highway-env's traffic models over arrays.

    Args:
        network: the roads.
        movements: roads over junctions.
        speeds_m_s: target speeds that a policy can choose from, evenly spaced.
        priority: movements to which others give way.
        clearance_m: see `coopsim.world.places.layout.Layout`.
        yields: likewise.
        signals: likewise.

    Attributes:
        lights: traffic lights.
    """

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
        self._network = network.arrays
        self._speeds = np.array(speeds_m_s, dtype=np.float64)
        always = movements_of(network, movements, priority, clearance_m, yields, lights=bool(signals))
        self.lights = Lights(signals, movements, always, tuple(yields or ()))

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, commands: Mapping[int, Command]) -> None:
        """Advance a fleet by `dt_s`.

        Args:
            fleet: changed in place.
            people: (M,) `BODY`, obstacles for vehicles.
            dt_s: time step.
            commands: commands by row: an index into `MANEUVERS` for `CHAUFFEURED` vehicles, m/s² for `PEDALLED` ones,
                m/s² and rad for `STEERED` ones.
        """
        for row, command in commands.items():
            if isinstance(command, tuple):
                actuate(fleet.rows[row], *command, dt_s)
            elif isinstance(command, float):
                before = float(fleet.rows["acceleration"][row])
                fleet.rows["acceleration"][row] = approached(before, command, dt_s)
            else:
                _obey(self._network, fleet.rows, fleet.routes, row, command, self._speeds)
        self.lights.step(dt_s)
        movements = self.lights.movements
        if len(movements.role):
            grant(self._network, fleet.rows, fleet.routes, movements)
        _act(self._network, fleet.rows, fleet.routes, bodies_of(fleet.rows, people), movements)
        move(self._network, fleet.rows, dt_s)
        collide(fleet.rows, bodies_of(fleet.rows, people), dt_s)
        if movements.light.any():
            count_reds(self._network, fleet.rows, fleet.routes, movements)

    def way_ahead(self, fleet: Fleet, row: int) -> Route:
        """Return the way ahead of the vehicle in a row, in its own frame."""
        return way_ahead(self._network, self.lights.movements, fleet.rows, row, fleet.routes[row])


@njit(cache=True, nogil=True)
def _obey(network: LaneArrays, rows: NDArray[Any], routes: Ints, row: int, maneuver: int, speeds: Floats) -> None:
    """Set the target speed or lane of a maneuver, as highway-env's `MDPVehicle` does."""
    vehicle = rows[row]
    if maneuver in (_FASTER, _SLOWER):
        more = 1 if maneuver == _FASTER else -1
        chosen = min(max(closest_speed(speeds, vehicle.speed) + more, 0), len(speeds) - 1)
        vehicle.target_speed = speeds[chosen]
    plan_ahead(network, vehicle, routes[row])
    follow_road(network, vehicle, routes[row])
    if maneuver in (_LANE_LEFT, _LANE_RIGHT):
        lane = network.lanes[vehicle.target_lane]
        road = network.roads[lane.road]
        number = lane.number + (1 if maneuver == _LANE_RIGHT else -1)
        wanted = road.first_lane + min(max(number, 0), road.lanes - 1)
        if is_reachable(network.lanes[wanted], network.corners, vehicle.x, vehicle.y):
            vehicle.target_lane = wanted


@njit(cache=True, nogil=True)
def closest_speed(speeds: Floats, speed: float) -> int:
    """Return the index of the closest of evenly spaced `speeds` to `speed`, m/s."""
    last = len(speeds) - 1
    place = (speed - speeds[0]) / (speeds[last] - speeds[0]) * last
    return min(max(int(np.rint(place)), 0), last)


@njit(cache=True, nogil=True)
def _act(network: LaneArrays, rows: NDArray[Any], routes: Ints, bodies: NDArray[Any], movements: Movements) -> None:
    """Decide steering and acceleration of all vehicles."""
    scene = Scene(network, rows, routes, bodies, list_along_lanes(network, bodies))
    for me in range(len(rows)):
        vehicle, route = rows[me], routes[me]
        if vehicle.driver == CHAUFFEURED:
            plan_ahead(network, vehicle, route)
            follow_road(network, vehicle, route)
            vehicle.acceleration = SPEED_GAIN_1_S * (vehicle.target_speed - vehicle.speed)
        elif vehicle.driver == PEDALLED:
            plan_ahead(network, vehicle, route)
            follow_road(network, vehicle, route)
        elif vehicle.crashed or vehicle.driver in (PARKED, STEERED):
            continue
        elif vehicle.driver in (TOWN, UNYIELDING):
            vehicle.acceleration = min(max(_drive_in_town(scene, me, movements), -ACC_MAX), ACC_MAX)
        else:
            plan_ahead(network, vehicle, route)
            follow_road(network, vehicle, route)
            change_lane(scene, me)
            vehicle.acceleration = min(max(follow(scene, me), -ACC_MAX), ACC_MAX)
        vehicle.steering = steer(network.lanes[vehicle.target_lane], network.corners, vehicle)


@njit(cache=True, nogil=True, inline="always")
def _drive_in_town(scene: Scene, me: int, movements: Movements) -> float:
    network, vehicle, route = scene.network, scene.rows[me], scene.routes[me]
    plan_ahead(network, vehicle, route)
    leader, leader_m = nearest_on_route(scene, me)
    follow_road(network, vehicle, route)
    plan_ahead(network, vehicle, route)
    acceleration = drive(scene, me, leader, leader_m)
    line_m = stop_line_m(network, vehicle, route, movements)
    if line_m < np.inf:
        acceleration = min(acceleration, stop_at(scene, me, line_m))
    if vehicle.ends and network.roads[route[vehicle.route_length - 1, 0]].ways == 0:
        acceleration = min(acceleration, stop_at(scene, me, end_of_route(network, vehicle, route)))
    return acceleration
