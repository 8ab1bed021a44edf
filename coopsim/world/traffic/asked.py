"""Movements that vehicles ask for, and the lines before them.

A vehicle asks for the next movement ahead. Between curved ones, as maps have them, a lane may be too short to stop in:
it asks for the movement behind such a lane together with the one before it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.types.driving import RED
from coopsim.world.traffic.fleet import CHAUFFEURED, PEDALLED, STEERED, UNYIELDING, Vehicle
from coopsim.world.traffic.lane_geometry import local_coordinates
from coopsim.world.traffic.lanes import POLYLINE, LaneArrays
from coopsim.world.traffic.movements import FIRST, Movements
from coopsim.world.traffic.routes import lane_of_route, start_of_route
from coopsim.world.traffic.rules import VEHICLE_LENGTH_M, extra_gap

GRANTED = 0
"""Ticket of a vehicle that may go. A waiting one has a ticket > 0, in the order of asking; -1: does not ask."""

LOST = -2  # ticket of a vehicle that must give way, had a grant and asks again: it keeps its place

AT_ONCE = 5
"""Movements of one vehicle: the one that its tail is leaving, the one that it asks for, those behind short lanes."""

_STAND_M = 11.5  # from the middle of a waiting car to its line, at most
_STOP_M, _STOP_M_S2 = 9.0, 3.0  # a lane is long enough to stop in from: this, and the way of this braking

_STOPPING_M_S2, _BEFORE_LINE_M = 4.0, 2.0  # braking for a light, and where the middle of a vehicle would then stand
_PASSED_M, _PASSED_S = 0.5, 0.1  # farther behind a line a car has passed it before
_CRAWLING_M_S = 3.0  # slower vehicles stop even where they stand beyond the line


@njit(cache=True, nogil=True)
def line_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> tuple[int, float]:
    """Return the place in the route of the first movement (-1: none), and the distance (m) to its start."""
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if movement_of[route[k, 0]] >= 0:
            return k, distance_m
        distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return -1, np.inf


@njit(cache=True, nogil=True)
def count_reds(network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements) -> None:
    """Count the red lights that agents' cars have just run: whose line the front crosses while the light is red."""
    for me in range(len(rows)):
        vehicle = rows[me]
        if vehicle.driver in (CHAUFFEURED, PEDALLED, STEERED):
            movement, beyond_m = _entered(network, vehicle, routes[me], movements.of_road)
            if movement >= 0 and movement + 1 != vehicle.over:
                # A steered car may change to another one when it is over the junction.
                fresh = beyond_m < _PASSED_M + _PASSED_S * vehicle.speed
                vehicle.red_lights += fresh and movements.light[movement] == RED
                vehicle.over = movement + 1


@njit(cache=True, nogil=True)
def _entered(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> tuple[int, float]:
    """Return the last movement that the front of a vehicle has entered (-1: none), and how far it is beyond, m."""
    entered, beyond_m = -1, 0.0
    ahead_m = vehicle.length / 2 - start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if ahead_m < 0:
            break
        if movement_of[route[k, 0]] >= 0:
            entered, beyond_m = movement_of[route[k, 0]], ahead_m
        ahead_m -= network.lanes[lane_of_route(network, vehicle, route, k)].length
    return entered, beyond_m


@njit(cache=True, nogil=True)
def can_stop(vehicle: Vehicle, line_m: float) -> bool:
    """Return whether a vehicle can stop for a light that turns yellow, at a distance to its line (m)."""
    before_m = _BEFORE_LINE_M * min(vehicle.speed / _CRAWLING_M_S, 1.0)  # one that stands at the line stays there
    return line_m > before_m + vehicle.speed**2 / (2 * _STOPPING_M_S2)


@njit(cache=True, nogil=True)
def is_short(network: LaneArrays, vehicle: Vehicle, road: int, back_m: float) -> bool:
    """Return whether a vehicle that waits so far back on a road would still stand in the movement before it."""
    lane = network.lanes[network.roads[road].first_lane]
    stand_m = _STAND_M + back_m + extra_gap(vehicle.length, VEHICLE_LENGTH_M) + vehicle.length / 2
    return bool(lane.kind == POLYLINE and lane.length < stand_m)


@njit(cache=True, nogil=True)
def _next_at_once(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements, k: int) -> int:
    """Return the place in the route of the movement that a vehicle needs together with that at place `k`; -1: none."""
    if k + 1 >= vehicle.route_length:
        return -1
    if movements.of_road[route[k + 1, 0]] >= 0:
        return k + 1 if network.lanes[network.roads[route[k + 1, 0]].first_lane].kind == POLYLINE else -1
    beyond = movements.of_road[route[k + 2, 0]] if k + 2 < vehicle.route_length else -1
    return k + 2 if beyond >= 0 and is_short(network, vehicle, route[k + 1, 0], movements.back_m[beyond]) else -1


@njit(cache=True, nogil=True)
def movements_of_all(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements
) -> tuple[Ints, Floats, Ints, Ints]:
    """Return what all vehicles ask for.

    That is their movements (N, `AT_ONCE`), -1: none; how far along each the tail is (m); the place in its route (N,) of
    the last one; and the role (N,) of all together. Who can still stop loses the grant where one of them is closed.
    """
    asked, tail_m = np.full((len(rows), AT_ONCE), -1), np.zeros((len(rows), AT_ONCE))
    last, role = np.full(len(rows), -1), np.full(len(rows), FIRST)
    for i in range(len(rows)):
        vehicle, route = rows[i], routes[i]
        half_m = vehicle.length / 2
        if vehicle.left > 0:
            lane = network.lanes[network.roads[movements.road[vehicle.left - 1]].first_lane]
            x, y = vehicle.x - half_m * math.cos(vehicle.heading), vehicle.y - half_m * math.sin(vehicle.heading)
            tail_m[i, 0], _ = local_coordinates(lane, network.corners, x, y)
            if tail_m[i, 0] >= lane.length:
                vehicle.left = 0
            asked[i, 0] = vehicle.left - 1
        if vehicle.movement < 0:
            continue
        k, line_m = line_ahead(network, vehicle, route, movements.of_road)
        place, distance_m, closed = k, line_m, False
        for slot in range(1, AT_ONCE):
            movement = movements.of_road[route[k, 0]]
            asked[i, slot], tail_m[i, slot], last[i] = movement, -distance_m - half_m, k
            closed |= movements.closed[movement]
            role[i] = min(role[i], movements.role[movement])
            k = _next_at_once(network, vehicle, route, movements, k)
            if k < 0:
                break
            while place < k:
                distance_m += network.lanes[lane_of_route(network, vehicle, route, place)].length
                place += 1
        obeys = vehicle.driver != CHAUFFEURED and vehicle.driver != UNYIELDING
        if closed and obeys and vehicle.ticket == GRANTED and can_stop(vehicle, line_m):
            vehicle.ticket = LOST
    return asked, tail_m, last, role


@njit(cache=True, nogil=True)
def stop_line_m(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements) -> float:
    """Return the distance to the line at which a vehicle has to stop as things are, m; infinite if there is none.

    On a movement it is the next one, if the lane before it is too short to stop in from this speed.
    """
    movement_of = movements.of_road
    k, line_m = line_ahead(network, vehicle, route, movement_of)
    if vehicle.ticket > GRANTED and line_m > 0:
        return float(line_m - movements.back_m[vehicle.movement])
    if vehicle.ticket != GRANTED or k != 0:
        return np.inf
    last = _next_at_once(network, vehicle, route, movements, k)
    while last >= 0:
        k = last
        last = _next_at_once(network, vehicle, route, movements, k)
    if k + 2 >= vehicle.route_length or movement_of[route[k + 1, 0]] >= 0 or movement_of[route[k + 2, 0]] < 0:
        return np.inf
    lane = network.lanes[network.roads[route[k + 1, 0]].first_lane]
    if lane.kind != POLYLINE or lane.length > _STOP_M + vehicle.speed**2 / (2 * _STOP_M_S2):
        return np.inf
    for place in range(k + 2):
        line_m += network.lanes[lane_of_route(network, vehicle, route, place)].length
    return float(line_m - movements.back_m[movement_of[route[k + 2, 0]]])
