"""Routes of vehicles: turns drawn ahead, and the lane that follows, as kernels."""

from __future__ import annotations

import numpy as np

from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic.fleet import Vehicle
from coopsim.world.traffic.lane_geometry import distance_to, local_coordinates, position_at
from coopsim.world.traffic.lanes import POLYLINE, LaneArrays, RoadRow
from coopsim.world.traffic.rules import LONG_M, VEHICLE_LENGTH_M, draw_turn

WIDE_M = 7.0
"""Least radius of the curved lanes that long vehicles choose, where they can: a bus of 12.3 m makes no tighter bend."""

_DRAWS = 8  # of a turn that is wide enough


@njit(cache=True, nogil=True)
def plan_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """Draw turns until the route is full, or the road ends. Long vehicles avoid those that are too tight for them."""
    here = network.lanes[vehicle.target_lane].road
    if vehicle.route_length == 0 or route[0, 0] != here:
        # Without a lane's number: where a route has one, MOBIL changes no lane.
        route[0, 0], route[0, 1] = here, -1
        vehicle.route_length = 1
    while vehicle.route_length < len(route):
        road: RoadRow = network.roads[route[vehicle.route_length - 1, 0]]
        if road.ways == 0:
            return
        ways = road.inner_ways if vehicle.stays and road.inner_ways > 0 else road.ways
        for _ in range(_DRAWS if vehicle.length > LONG_M else 1):
            way = network.ways[road.first_way + draw_turn(vehicle.turn_key, vehicle.turns, ways)]
            vehicle.turns += 1
            lane = network.lanes[network.roads[way].first_lane]
            if lane.kind != POLYLINE or lane.radius >= WIDE_M:
                break
        route[vehicle.route_length, 0] = way
        route[vehicle.route_length, 1] = -1
        vehicle.route_length += 1


@njit(cache=True, nogil=True)
def lane_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints, k: int) -> int:
    """Return the lane of the route's road `k`: the one that the route names, or that with the present number."""
    road: RoadRow = network.roads[route[k, 0]]
    number: int = route[k, 1]
    if number < 0:
        number = min(network.lanes[vehicle.target_lane].number, road.lanes - 1)
    return road.first_lane + number


@njit(cache=True, nogil=True)
def start_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints) -> float:
    """Return the distance to the start of the route's first road, m; <= 0, because the vehicle is on it."""
    lane = network.lanes[lane_of_route(network, vehicle, route, 0)]
    return -local_coordinates(lane, network.corners, vehicle.x, vehicle.y)[0]


@njit(cache=True, nogil=True)
def end_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints) -> float:
    """Return the distance to the end of the route's last road, m."""
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return distance_m


@njit(cache=True, nogil=True)
def follow_road(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """Target the next lane at the end of the target lane."""
    lane = network.lanes[vehicle.target_lane]
    along, _ = local_coordinates(lane, network.corners, vehicle.x, vehicle.y)
    if along > lane.length - VEHICLE_LENGTH_M / 2:
        x, y = position_at(lane, network.corners, along)
        vehicle.target_lane = _next_lane(network, vehicle, route, x, y)


@njit(cache=True, nogil=True)
def _next_lane(network: LaneArrays, vehicle: Vehicle, route: Ints, x: float, y: float) -> int:
    """Return the route's next lane, or without a route the closest to (x, y); the same lane where the road ends."""
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
        distance = distance_to(network.lanes[lane], network.corners, x, y)
        if distance < least:
            best, least = lane, distance
    return best


@njit(cache=True, nogil=True)
def _lane_on_road(network: LaneArrays, lane: int, way: int, number: int, x: float, y: float) -> int:
    """Return the lane of the same number (or `number`, if >= 0) on a road with as many lanes, else the closest."""
    road: RoadRow = network.roads[way]
    if network.roads[network.lanes[lane].road].lanes == road.lanes:
        return road.first_lane + (number if number >= 0 else network.lanes[lane].number)
    best, least = road.first_lane, np.inf
    for k in range(road.first_lane, road.first_lane + road.lanes):
        distance = distance_to(network.lanes[k], network.corners, x, y)
        if distance < least:
            best, least = k, distance
    return best
