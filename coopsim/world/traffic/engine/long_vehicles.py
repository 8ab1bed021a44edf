"""What long vehicles need next to the others' rules: how far they swing out, and where their tails still are."""

from __future__ import annotations

import math
from typing import Any

from numba import njit
from numpy.typing import NDArray

from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import Body, Vehicle
from coopsim.world.traffic.engine.lanes import (
    CIRCULAR,
    Lane,
    LaneArrays,
    distance_to_box,
    heading_at,
    local_coordinates,
)
from coopsim.world.traffic.engine.routes import lane_of_route, start_of_route

LONG_M = 6.0
"""Who is longer turns off tail last: it is still in a lane where its middle is not. For others IDM's gap has room."""

BESIDE_M = 0.4
"""Who leaves no more room than this beside a vehicle is in its way."""

SAME_WAY = 0.5
"""Cosine between the headings of two who go the same way, at least."""


@njit(cache=True, nogil=True)
def swing_m(length_m: float, axle_m: float, radius_m: float) -> float:
    """How far outside the way of its front axle, a bend, the front of a long vehicle gets.

    To the second order in the length, which is a little more than it is. With the axles at its ends (`Vehicle.axle_m`)
    a vehicle has no front before the axle, and this is 0.
    """
    return ((length_m / 2 + axle_m) ** 2 - (2 * axle_m) ** 2) / (2 * radius_m)


@njit(cache=True, nogil=True)
def swing_on(vehicle: Vehicle, lane: Lane) -> float:
    """How far a vehicle swings out on a lane, m."""
    if lane.kind != CIRCULAR:
        return 0.0
    return float(swing_m(vehicle.length, vehicle.axle_m, lane.radius))


@njit(cache=True, nogil=True)
def tail_ahead(
    network: LaneArrays,
    vehicle: Vehicle,
    route: Ints,
    bodies: NDArray[Any],
    vehicles: int,
    me: int,
    limit_m: float,
) -> tuple[int, float]:
    """Who turns off the planned route ahead of a vehicle, with its middle off and its tail still on it.

    Args:
        network: the roads.
        vehicle: who looks.
        route: its route.
        bodies: (N,) `BODY`, of which the first are vehicles.
        vehicles: how many.
        me: number of who looks.
        limit_m: nobody is looked for from this distance on.

    Returns:
        The nearest long vehicle of that kind (-1: none), and the distance (m) to where its middle would be had it gone
        straight on; without one it is `limit_m`.
    """
    nearest, nearest_m = -1, limit_m
    here_m = start_of_route(network, vehicle, route)
    for other in range(vehicles):
        body: Body = bodies[other]
        half_m = body.length / 2
        x, y = body.x - half_m * body.dir_x, body.y - half_m * body.dir_y
        if body.length <= LONG_M or other == me or math.hypot(x - vehicle.x, y - vehicle.y) > nearest_m:
            continue
        end_m = here_m
        for k in range(vehicle.route_length):
            lane: Lane = network.lanes[lane_of_route(network, vehicle, route, k)]
            start_m, end_m = end_m, end_m + lane.length
            reach = (vehicle.width + body.width) / 2 + BESIDE_M + swing_on(vehicle, lane)
            if distance_to_box(lane, x, y) > reach:  # saves time
                continue
            along, aside = local_coordinates(lane, x, y)
            distance_m = start_m + along + half_m
            if not (0 <= along <= lane.length and half_m < distance_m < nearest_m):
                continue
            middle_is_off = abs(local_coordinates(lane, body.x, body.y)[1]) >= reach
            same_way = math.cos(body.heading - heading_at(lane, along)) > SAME_WAY
            if abs(aside) < reach and middle_is_off and same_way:
                nearest, nearest_m = other, distance_m
    return nearest, nearest_m
