"""The way ahead of a vehicle, as its planner gets it: points of its lanes, their limits and its right of way."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import unchecked
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.types.driving import GIVES_WAY, HAS_PRIORITY, NO_LIGHT, NOBODY_FIRST, Route
from coopsim.world.places.polyline import LATERAL_M_S2
from coopsim.world.traffic.asked import can_stop
from coopsim.world.traffic.fleet import Vehicle
from coopsim.world.traffic.lane_geometry import heading_at, local_coordinates, position_at, radius_at
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.movements import FIRST, YIELDS, Movements
from coopsim.world.traffic.routes import lane_of_route, plan_ahead, start_of_route

SPACING_M, REACH_M = 1.0, 100.0
"""Distance between the points of a route, and how far it reaches."""

BEFORE_LINE_M = 1.0
"""Distance that a front bumper leaves to a line."""


def way_ahead(network: LaneArrays, movements: Movements, rows: NDArray[Any], me: int, route: Ints) -> Route:
    """Return the way ahead of a vehicle in its own frame.

    Beyond the roads that it has decided on, it goes straight on.

    Args:
        network: the roads.
        movements: the movements of the place, which have the right of way.
        rows: the fleet's.
        me: row of the vehicle.
        route: (K, 2) its row of `Fleet.routes`. Turns that it lacks are drawn, as the next step would.
    """
    count = round(REACH_M / SPACING_M) + 1
    found = points_ahead(network, movements, rows, me, route, SPACING_M, count, obeys=True)
    cos, sin = np.cos(found.heading), np.sin(found.heading)
    return unchecked(
        Route,
        points=found.points @ np.array([[cos, -sin], [sin, cos]]),
        spacing_m=SPACING_M,
        speed_limit_m_s=found.limit_m_s,
        right_of_way=found.rights,
        lane_width_m=found.width_m,
        beside=found.beside,
        lights=found.lights,
        goal_m=math.inf,
        length_m=math.inf,
    )


class PointsAhead(NamedTuple):
    """Points of the middle of the lanes ahead of a vehicle.

    Attributes:
        points: (K, 2) m from the vehicle, in the axes of the world.
        limit_m_s: (K,) legal and comfortable speeds; 0 from a red light on, if the vehicle obeys.
        rights: (K,) right of way.
        heading: the vehicle's, rad.
        lanes: (K,) numbers.
        places: (K,) of their roads in the route.
        width_m: (K,) of the lanes.
        beside: (K, 2) numbers of lanes of the same road to the left and to the right.
        lights: (K,) of the ways over junctions.
    """

    points: Floats
    limit_m_s: Floats
    rights: Ints
    heading: float
    lanes: Ints
    places: Ints
    width_m: Floats
    beside: Ints
    lights: Ints


@njit(cache=True, nogil=True)
def points_ahead(
    network: LaneArrays,
    movements: Movements,
    rows: NDArray[Any],
    me: int,
    route: Ints,
    spacing_m: float,
    count: int,
    obeys: bool,
) -> PointsAhead:
    """Return `count` points of the middle of the lanes ahead of the vehicle in row `me`."""
    vehicle: Vehicle = rows[me]
    plan_ahead(network, vehicle, route)
    stop_m = _red_light(network, movements, vehicle, route) if obeys else np.inf
    number, place = vehicle.target_lane, 0
    along, _ = local_coordinates(network.lanes[number], network.corners, vehicle.x, vehicle.y)
    points, limit, rights = np.empty((count, 2)), np.empty(count), np.empty(count, dtype=np.int64)
    lanes, places = np.empty(count, np.int64), np.empty(count, np.int64)
    width_m, beside, lights = np.empty(count), np.empty((count, 2), np.int64), np.full(count, NO_LIGHT)
    for k in range(count):
        while along > network.lanes[number].length and place + 1 < vehicle.route_length:
            along -= network.lanes[number].length
            place += 1
            number = lane_of_route(network, vehicle, route, place)
        lanes[k], places[k] = number, place
        lane = network.lanes[number]
        known = min(along, lane.length)
        x, y = position_at(lane, network.corners, known)
        heading = heading_at(lane, network.corners, known)
        points[k, 0] = x + (along - known) * math.cos(heading) - vehicle.x
        points[k, 1] = y + (along - known) * math.sin(heading) - vehicle.y
        radius_m, rights[k] = radius_at(lane, network.corners, known), NOBODY_FIRST
        limit[k] = min(lane.speed_limit, math.sqrt(LATERAL_M_S2 * radius_m))
        width_m[k], beside[k, 0] = lane.width, lane.number
        beside[k, 1] = network.roads[lane.road].lanes - 1 - lane.number
        movement = movements.of_road[lane.road]
        if movement >= 0:
            lights[k] = movements.light[movement]
        if movement >= 0 and movements.role[movement] == FIRST:
            rights[k] = HAS_PRIORITY
        elif movement >= 0 and movements.role[movement] == YIELDS:
            rights[k] = GIVES_WAY
        if (k + 1) * spacing_m > stop_m:  # planners stop at the first point that says so, or a little beyond
            limit[k], rights[k] = 0.0, GIVES_WAY
        along += spacing_m
    return PointsAhead(points, limit, rights, vehicle.heading, lanes, places, width_m, beside, lights)


@njit(cache=True, nogil=True)
def _red_light(network: LaneArrays, movements: Movements, vehicle: Vehicle, route: Ints) -> float:
    """Return the distance to where a vehicle must stop for a red or yellow light, m; infinite if for none."""
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        movement = movements.of_road[route[k, 0]]
        if movement >= 0 and movements.closed[movement] and can_stop(vehicle, distance_m):
            return max(distance_m - vehicle.length / 2 - BEFORE_LINE_M, 0.0)
        distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return np.inf
