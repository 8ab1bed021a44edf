"""Driving on short, bent roads: along the planned route, slower in bends, behind who is on it, and by the junction.

The model is that of `coopsim.world.traffic.highway_reference.drivers.TownDriver`, which writes it in highway-env's
classes.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit
from numpy.typing import NDArray

from coopsim.types import Ints
from coopsim.world.traffic.engine.car_following import COMFORT_ACC_MAX, desired_gap, free_road, gap_at
from coopsim.world.traffic.engine.fleet import Body, Vehicle
from coopsim.world.traffic.engine.lanes import CIRCULAR, VEHICLE_LENGTH_M, Lane, LaneArrays, heading_at
from coopsim.world.traffic.engine.long_vehicles import BESIDE_M, SAME_WAY, swing_on, tail_ahead
from coopsim.world.traffic.engine.neighbours import LaneLists, first_from
from coopsim.world.traffic.engine.routes import lane_of_route, start_of_route

LOOK_AHEAD_M = 60.0
EASY_BRAKING_M_S2 = 2.0

STEP_OUT_S = 2.0
"""People who will be in the lane by then are as good as in it."""

STANDING_M_S = 0.5
"""Who is slower than this stands."""


@njit(cache=True, nogil=True)
def drive(
    network: LaneArrays, vehicle: Vehicle, route: Ints, bodies: NDArray[Any], me: int, leader: int, leader_m: float
) -> float:
    """IDM on a free road, or behind `leader` (-1: nobody) at a distance along the route, m/s2."""
    free = _free(network, vehicle, route)
    if leader < 0:
        return free
    gap = desired_gap(vehicle, bodies[me], bodies[leader])
    return min(free, free - _push(gap, leader_m))


@njit(cache=True, nogil=True)
def stop_at(network: LaneArrays, vehicle: Vehicle, route: Ints, body: Body, line_m: float) -> float:
    """IDM before a stop line, m/s2: as behind a standing vehicle of usual length."""
    gap = gap_at(vehicle, body, body.speed, VEHICLE_LENGTH_M)
    return _free(network, vehicle, route) - _push(gap, line_m)


@njit(cache=True, nogil=True)
def look_ahead(
    network: LaneArrays, vehicle: Vehicle, route: Ints, bodies: NDArray[Any], vehicles: int, lists: LaneLists, me: int
) -> tuple[int, float]:
    """The nearest vehicle or person on the planned route (-1: none), and the distance (m) between middles along it."""
    nearest, nearest_m = -1, LOOK_AHEAD_M
    start_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if start_m > nearest_m:
            break
        number = lane_of_route(network, vehicle, route, k)
        lane: Lane = network.lanes[number]
        for entry in range(first_from(lists, number, max(0.0, -start_m)), lists.first[number] + lists.entries[number]):
            along, other = lists.along[entry], lists.who[entry]
            distance_m = start_m + along
            if along > lane.length or distance_m >= nearest_m:
                break
            if other == me or distance_m <= 0:
                continue
            if _in_my_way(vehicle, bodies[other], other < vehicles, lane, along, lists.aside[entry]):
                nearest, nearest_m = other, distance_m
                break
        start_m += lane.length
    tail, tail_m = tail_ahead(network, vehicle, route, bodies, vehicles, me, nearest_m)
    return (tail, tail_m) if tail >= 0 else (nearest, nearest_m)


@njit(cache=True, nogil=True)
def _in_my_way(vehicle: Vehicle, other: Body, drives: bool, lane: Lane, along: float, aside: float) -> bool:
    """Whether to stay behind `other`, which is `along` and `aside` on the lane.

    Vehicles if they go the same way (who crosses is the junction's business), are wrecks, or stand across with their
    ends in the lane; people if they are in the lane or about to step into it. Who swings out itself keeps behind those
    who go the same way on the outside, too; not beside who comes the other way, or the two would wait for each other.
    """
    reach = (vehicle.width + other.width) / 2 + BESIDE_M
    heading = other.heading - heading_at(lane, along)
    if drives:
        same_way = math.cos(heading) > SAME_WAY
        if same_way:
            reach += swing_on(vehicle, lane)
        if other.crashed or other.speed < STANDING_M_S:
            across = abs(math.cos(heading)) * other.width + abs(math.sin(heading)) * other.length
            return abs(aside) < reach + (across - other.width) / 2
        return abs(aside) < reach and same_way
    if lane.kind == CIRCULAR:  # the rear of a long vehicle goes inside the bend
        reach += vehicle.length**2 / (8 * lane.radius)
    soon = aside + other.speed * math.sin(heading) * STEP_OUT_S
    return min(aside, soon) < reach and max(aside, soon) > -reach


@njit(cache=True, nogil=True)
def _free(network: LaneArrays, vehicle: Vehicle, route: Ints) -> float:
    """IDM on a free road, towards the speed that the bends ahead allow, m/s2."""
    speed = vehicle.target_speed
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        lane: Lane = network.lanes[lane_of_route(network, vehicle, route, k)]
        speed = min(speed, math.sqrt(lane.speed_limit**2 + 2 * EASY_BRAKING_M_S2 * max(distance_m, 0.0)))
        distance_m += lane.length
    return free_road(vehicle.speed, speed)


@njit(cache=True, nogil=True)
def _push(gap: float, distance_m: float) -> float:
    """What IDM takes off for a desired gap at a distance, m/s2; a negative one is no reason to brake."""
    return COMFORT_ACC_MAX * (max(gap, 0.0) / max(distance_m, 0.1)) ** 2
