"""Which road comes next: highway-env's rule, and turns that are drawn ahead, so that others can know them."""

from __future__ import annotations

import numpy as np
from numba import njit

from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import Vehicle
from coopsim.world.traffic.engine.lanes import (
    VEHICLE_LENGTH_M,
    LaneArrays,
    RoadRow,
    distance_to,
    local_coordinates,
    position_at,
)


@njit(cache=True, nogil=True)
def draw_turn(key: int, count: int, ways: int) -> int:
    """Draw number `count` of the vehicle `key`, in [0, ways).

    A hash (SplitMix64: Steele, Lea and Flood, OOPSLA 2014) and not a stream: one vehicle's turns depend on no other's.
    """
    z = np.uint64(key) + np.uint64(count + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int((z ^ (z >> np.uint64(31))) % np.uint64(ways))


@njit(cache=True, nogil=True)
def plan_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """Draw turns until the route is as long as there is room for, or the road ends."""
    here = network.lanes[vehicle.target_lane].road
    if vehicle.route_length == 0 or route[0, 0] != here:
        # Without the lane's number: MOBIL changes no lane where a route names one.
        route[0, 0], route[0, 1] = here, -1
        vehicle.route_length = 1
    while vehicle.route_length < len(route):
        road: RoadRow = network.roads[route[vehicle.route_length - 1, 0]]
        if road.ways == 0:
            return
        turn = draw_turn(vehicle.turn_key, vehicle.turns, road.ways)
        vehicle.turns += 1
        route[vehicle.route_length, 0] = network.ways[road.first_way + turn]
        route[vehicle.route_length, 1] = -1
        vehicle.route_length += 1


@njit(cache=True, nogil=True)
def lane_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints, k: int) -> int:
    """The lane of the route's road `k`: that which the route names, or the number that it is in now."""
    road: RoadRow = network.roads[route[k, 0]]
    number: int = route[k, 1]
    if number < 0:
        number = min(network.lanes[vehicle.target_lane].number, road.lanes - 1)
    return road.first_lane + number


@njit(cache=True, nogil=True)
def start_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints) -> float:
    """Distance to the start of the route's first road, m: it is on it, so <= 0."""
    lane = network.lanes[lane_of_route(network, vehicle, route, 0)]
    return -local_coordinates(lane, vehicle.x, vehicle.y)[0]


@njit(cache=True, nogil=True)
def follow_road(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """At the end of the target lane, go for the next."""
    lane = network.lanes[vehicle.target_lane]
    along, _ = local_coordinates(lane, vehicle.x, vehicle.y)
    if along > lane.length - VEHICLE_LENGTH_M / 2:
        x, y = position_at(lane, along)
        vehicle.target_lane = _next_lane(network, vehicle, route, x, y)


@njit(cache=True, nogil=True)
def _next_lane(network: LaneArrays, vehicle: Vehicle, route: Ints, x: float, y: float) -> int:
    """The route's, or without one that which is closest to (x, y); the same where the road ends."""
    here = network.lanes[vehicle.target_lane].road
    if vehicle.route_length > 0 and route[0, 0] == here:
        for k in range(1, vehicle.route_length):
            route[k - 1, 0], route[k - 1, 1] = route[k, 0], route[k, 1]
        vehicle.route_length -= 1
    if vehicle.route_length > 0 and network.roads[route[0, 0]].start == network.roads[here].end:
        return _lane_on_road(network, vehicle.target_lane, route[0, 0], route[0, 1], x, y)
    best, least = vehicle.target_lane, np.inf
    for k in range(network.roads[here].ways):
        way = network.ways[network.roads[here].first_way + k]
        lane = _lane_on_road(network, vehicle.target_lane, way, -1, x, y)
        distance = distance_to(network.lanes[lane], x, y)
        if distance < least:
            best, least = lane, distance
    return best


@njit(cache=True, nogil=True)
def _lane_on_road(network: LaneArrays, lane: int, way: int, number: int, x: float, y: float) -> int:
    """The same number on a road with as many lanes (or `number`, if there is one), else the closest to (x, y)."""
    road: RoadRow = network.roads[way]
    if network.roads[network.lanes[lane].road].lanes == road.lanes:
        return road.first_lane + (number if number >= 0 else network.lanes[lane].number)
    best, least = road.first_lane, np.inf
    for k in range(road.first_lane, road.first_lane + road.lanes):
        distance = distance_to(network.lanes[k], x, y)
        if distance < least:
            best, least = k, distance
    return best
