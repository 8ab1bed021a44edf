"""Driving on short, bent roads: along the planned route, slower in bends, behind obstacles, and by the junction.

The rules are those of `coopsim.world.traffic.rules.driving`, which the highway-env engine's `TownDriver` follows, too.
"""

from __future__ import annotations

import math

from coopsim.support.kernels import njit
from coopsim.world.traffic.engine.car_following import desired_gap, free_road, gap_at
from coopsim.world.traffic.engine.fleet import Body, Vehicle
from coopsim.world.traffic.engine.lanes import CIRCULAR, LaneRow, distance_to_box, heading_at, local_coordinates
from coopsim.world.traffic.engine.neighbours import Scene, first_from
from coopsim.world.traffic.engine.routes import lane_of_route, start_of_route
from coopsim.world.traffic.rules.driving import (
    LONG_M,
    LOOK_AHEAD_M,
    STANDING_M_S,
    VEHICLE_LENGTH_M,
    approach_speed,
    cut_inside_m,
    interaction,
    is_person_in_way,
    is_tail_in_way,
    is_vehicle_in_way,
    reach_beside,
    swing_m,
)


@njit(cache=True, nogil=True, inline="always")
def drive(scene: Scene, me: int, leader: int, leader_m: float) -> float:
    """Return IDM's acceleration on a free road, or behind `leader` (-1: none) at a distance along the route, m/s2."""
    free = _free(scene, me)
    if leader < 0:
        return free
    gap = desired_gap(scene.rows[me], scene.bodies[me], scene.bodies[leader])
    return min(free, free - interaction(gap, leader_m))


@njit(cache=True, nogil=True, inline="always")
def stop_at(scene: Scene, me: int, line_m: float) -> float:
    """Return IDM's acceleration before a stop line, m/s2: as behind a standing vehicle of usual length."""
    body: Body = scene.bodies[me]
    gap = gap_at(scene.rows[me], body, body.speed, VEHICLE_LENGTH_M)
    return _free(scene, me) - interaction(gap, line_m)


@njit(cache=True, nogil=True, inline="always")
def look_ahead(scene: Scene, me: int) -> tuple[int, float]:
    """Return the nearest obstacle on the planned route (-1: none), and the distance (m) between middles along it."""
    network, lists, vehicles = scene.network, scene.lists, len(scene.rows)
    vehicle, route = scene.rows[me], scene.routes[me]
    nearest, nearest_m = -1, LOOK_AHEAD_M
    start_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if start_m > nearest_m:
            break
        number = lane_of_route(network, vehicle, route, k)
        lane: LaneRow = network.lanes[number]
        for entry in range(first_from(lists, number, max(0.0, -start_m)), lists.first[number] + lists.entries[number]):
            along, other = lists.along[entry], lists.body[entry]
            distance_m = start_m + along
            if along > lane.length or distance_m >= nearest_m:
                break
            if other == me or distance_m <= 0:
                continue
            if _is_in_way(vehicle, scene.bodies[other], other < vehicles, lane, along, lists.aside[entry]):
                nearest, nearest_m = other, distance_m
                break
        start_m += lane.length
    return _tail_ahead(scene, me, nearest, nearest_m)


@njit(cache=True, nogil=True)
def _is_in_way(vehicle: Vehicle, other: Body, drives: bool, lane: LaneRow, along: float, aside: float) -> bool:
    reach_m = reach_beside(vehicle.width, other.width)
    angle = other.heading - heading_at(lane, along)
    if drives:
        stands = other.crashed or other.speed < STANDING_M_S
        return is_vehicle_in_way(aside, angle, other.length, other.width, stands, reach_m, _swing_on(vehicle, lane))
    if lane.kind == CIRCULAR:
        reach_m += cut_inside_m(vehicle.length, lane.radius)
    return is_person_in_way(aside, angle, other.speed, reach_m)


@njit(cache=True, nogil=True, inline="always")
def _tail_ahead(scene: Scene, me: int, nearest: int, nearest_m: float) -> tuple[int, float]:
    """Return `nearest`, or a long vehicle before it that turns off and still has its tail on the route.

    Its distance is that to where its middle would be had it gone straight on.
    """
    network, vehicle, route = scene.network, scene.rows[me], scene.routes[me]
    here_m = start_of_route(network, vehicle, route)
    for other in range(len(scene.rows)):
        body: Body = scene.bodies[other]
        half_m = body.length / 2
        x, y = body.x - half_m * body.dir_x, body.y - half_m * body.dir_y
        if body.length <= LONG_M or other == me or math.hypot(x - vehicle.x, y - vehicle.y) > nearest_m:
            continue
        end_m = here_m
        for k in range(vehicle.route_length):
            lane: LaneRow = network.lanes[lane_of_route(network, vehicle, route, k)]
            start_m, end_m = end_m, end_m + lane.length
            reach_m = reach_beside(vehicle.width, body.width) + _swing_on(vehicle, lane)
            if distance_to_box(lane, x, y) > reach_m:  # saves time
                continue
            along, aside = local_coordinates(lane, x, y)
            distance_m = start_m + along + half_m
            if not (0 <= along <= lane.length and half_m < distance_m < nearest_m):
                continue
            middle_aside = local_coordinates(lane, body.x, body.y)[1]
            if is_tail_in_way(aside, body.heading - heading_at(lane, along), middle_aside, reach_m):
                nearest, nearest_m = other, distance_m
    return nearest, nearest_m


@njit(cache=True, nogil=True)
def _swing_on(vehicle: Vehicle, lane: LaneRow) -> float:
    """Return how far a vehicle swings out on a lane, m."""
    if lane.kind != CIRCULAR:
        return 0.0
    return float(swing_m(vehicle.length, vehicle.axle_m, lane.radius))


@njit(cache=True, nogil=True, inline="always")
def _free(scene: Scene, me: int) -> float:
    """Return IDM's acceleration on a free road, towards the speed that the bends ahead allow, m/s2."""
    network, vehicle, route = scene.network, scene.rows[me], scene.routes[me]
    speed = vehicle.target_speed
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        lane: LaneRow = network.lanes[lane_of_route(network, vehicle, route, k)]
        speed = min(speed, approach_speed(lane.speed_limit, distance_m))
        distance_m += lane.length
    return free_road(vehicle.speed, speed)
