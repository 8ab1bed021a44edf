"""The intelligent driver model (IDM), and lane changes by MOBIL, as in highway-env.

IDM: Treiber, Hennecke and Helbing, "Congested traffic states in empirical observations and microscopic simulations",
Phys. Rev. E 62 (2000). MOBIL: Kesting, Treiber and Helbing, "General lane-changing model MOBIL for car-following
models", Transportation Research Record 1999 (2007).
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from coopsim.support.kernels import njit
from coopsim.world.places.polyline import polyline_speed
from coopsim.world.traffic import rules
from coopsim.world.traffic.fleet import PEDALLED, STEERED, TOWN, UNYIELDING, Body, Vehicle
from coopsim.world.traffic.lane_geometry import distance_to_box, heading_at, local_coordinates, radius_at
from coopsim.world.traffic.lanes import CIRCULAR, POLYLINE, LaneArrays, LaneRow
from coopsim.world.traffic.neighbours import LaneLists, Scene, behind, first_from, in_front
from coopsim.world.traffic.routes import lane_of_route, start_of_route

ACC_MAX = 6.0  # m/s2; limit of braking and accelerating
COMFORT_ACC_MIN = -5.0
DISTANCE_WANTED = 10.0  # m, between the middles of two of highway-env's usual vehicles
DELTA = 4.0

LANE_CHANGE_DELAY = 1.0  # s
LANE_CHANGE_MIN_ACC_GAIN = 0.2  # m/s2
LANE_CHANGE_MAX_BRAKING_IMPOSED = 2.0  # m/s2


@njit(cache=True, nogil=True)
def desired_gap(driver: Vehicle, ego: Body, front: Body) -> float:
    """Return the gap between middles that `driver` would keep in the place of `ego`, m."""
    closing = ego.speed - front.speed * (front.dir_x * ego.dir_x + front.dir_y * ego.dir_y)
    return gap_at(driver, ego, closing, front.length)


@njit(cache=True, nogil=True)
def gap_at(driver: Vehicle, ego: Body, closing: float, length: float) -> float:
    """Return the desired gap to an obstacle of a length (m) that comes nearer at a speed (m/s)."""
    dynamic = ego.speed * driver.time_wanted
    dynamic += ego.speed * closing / (2 * math.sqrt(-rules.COMFORT_ACC_MAX * COMFORT_ACC_MIN))
    return DISTANCE_WANTED + dynamic + rules.extra_gap(ego.length, length)


@njit(cache=True, nogil=True)
def free_road(speed: float, target_speed: float) -> float:
    """Return IDM's acceleration with nothing in front, m/s2."""
    return rules.COMFORT_ACC_MAX * (1 - math.pow(max(speed, 0.0) / abs(rules.not_zero(target_speed)), DELTA))


@njit(cache=True, nogil=True)
def acceleration(
    network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], driver: Vehicle, ego: int, front: int
) -> float:
    """Return IDM's acceleration of body `ego` behind body `front` (-1: none), m/s2; 0 if `ego` is no vehicle."""
    if ego < 0 or ego >= len(rows):
        return 0.0
    lane: LaneRow = network.lanes[rows[ego].lane]
    result = free_road(bodies[ego].speed, min(max(rows[ego].target_speed, 0.0), lane.speed_limit))
    if front >= 0:
        gap = desired_gap(driver, bodies[ego], bodies[front])
        distance = distance_along(lane, network.corners, bodies[ego], bodies[front])
        result -= rules.COMFORT_ACC_MAX * (gap / rules.not_zero(distance)) ** 2
    return result


@njit(cache=True, nogil=True)
def distance_along(lane: LaneRow, corners: NDArray[Any], ego: Body, other: Body) -> float:
    """Return the distance between the middles of two bodies along a lane, m."""
    return local_coordinates(lane, corners, other.x, other.y)[0] - local_coordinates(lane, corners, ego.x, ego.y)[0]


@njit(cache=True, nogil=True, inline="always")
def follow(scene: Scene, me: int) -> float:
    """Return IDM's acceleration behind the body in front in the own lane and the target lane, m/s2."""
    network, rows, vehicle = scene.network, scene.rows, scene.rows[me]
    result = _follow_on(network, rows, scene.bodies, scene.lists, me, vehicle.lane)
    if vehicle.lane != vehicle.target_lane:
        result = min(result, _follow_on(network, rows, scene.bodies, scene.lists, me, vehicle.target_lane))
    return result


@njit(cache=True, nogil=True)
def _follow_on(
    network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], lists: LaneLists, me: int, lane: int
) -> float:
    along, _ = local_coordinates(network.lanes[lane], network.corners, rows[me].x, rows[me].y)
    return acceleration(network, rows, bodies, rows[me], me, in_front(lists, network.lanes, lane, me, along))


@njit(cache=True, nogil=True, inline="always")
def change_lane(scene: Scene, me: int) -> None:
    """Choose a neighbouring lane from time to time; abandon it if another vehicle enters it just ahead."""
    driver: Vehicle = scene.rows[me]
    if driver.lane != driver.target_lane:
        _give_way(scene, me)
        return
    if driver.timer <= LANE_CHANGE_DELAY:
        return
    driver.timer = 0.0
    here = scene.network.lanes[driver.lane]
    road = scene.network.roads[here.road]
    for number in (here.number - 1, here.number + 1):
        if not 0 <= number < road.lanes or abs(driver.speed) < 1:
            continue
        lane = road.first_lane + number
        reachable = is_reachable(scene.network.lanes[lane], scene.network.corners, driver.x, driver.y)
        if not reachable or _is_taken(scene, me, lane):
            continue
        if _mobil(scene, me, lane):
            driver.target_lane = lane


@njit(cache=True, nogil=True)
def is_reachable(lane: LaneRow, corners: NDArray[Any], x: float, y: float) -> bool:
    """Return whether a vehicle at (x, y) may change to the lane."""
    along, aside = local_coordinates(lane, corners, x, y)
    return not lane.forbidden and abs(aside) <= 2 * lane.width and 0 <= along < lane.length + rules.VEHICLE_LENGTH_M


@njit(cache=True, nogil=True, inline="always")
def _give_way(scene: Scene, me: int) -> None:
    """Stay in the present lane if another vehicle enters the target lane within the desired gap."""
    rows, bodies, lanes = scene.rows, scene.bodies, scene.network.lanes
    driver: Vehicle = rows[me]
    here = lanes[driver.lane]
    if here.road != lanes[driver.target_lane].road:
        return
    for k in range(len(rows)):
        if k != me and rows[k].lane != driver.target_lane and rows[k].target_lane == driver.target_lane:
            distance = distance_along(here, scene.network.corners, bodies[me], bodies[k])
            if 0 < distance < desired_gap(driver, bodies[me], bodies[k]):
                driver.target_lane = driver.lane
                return


@njit(cache=True, nogil=True, inline="always")
def _is_taken(scene: Scene, me: int, lane: int) -> bool:
    """Return whether another vehicle is about to enter the lane close by."""
    rows, bodies = scene.rows, scene.bodies
    here = scene.network.lanes[rows[me].lane]
    for k in range(len(rows)):
        moves_in = k != me and rows[k].target_lane == lane and rows[k].lane != lane
        if moves_in and abs(distance_along(here, scene.network.corners, bodies[me], bodies[k])) < rules.MERGE_M:
            return True
    return False


@njit(cache=True, nogil=True, inline="always")
def _mobil(scene: Scene, me: int, lane: int) -> bool:
    """Return whether a lane change is safe for the follower there, and gains enough (highway-env's politeness is 0)."""
    lanes, rows, bodies = scene.network.lanes, scene.rows, scene.bodies
    driver, route = rows[me], scene.routes[me]
    along, _ = local_coordinates(lanes[lane], scene.network.corners, driver.x, driver.y)
    front = in_front(scene.lists, lanes, lane, me, along)
    follower = behind(scene.lists, lanes, lane, me, along)
    if acceleration(scene.network, rows, bodies, driver, follower, me) < -LANE_CHANGE_MAX_BRAKING_IMPOSED:
        return False
    there = acceleration(scene.network, rows, bodies, driver, me, front)
    if driver.route_length > 0 and route[0, 1] >= 0:
        number = lanes[driver.target_lane].number
        towards = _sign(lanes[lane].number - number) == _sign(route[0, 1] - number)
        return towards and there >= -LANE_CHANGE_MAX_BRAKING_IMPOSED
    return there - _follow_on(scene.network, rows, bodies, scene.lists, me, driver.lane) >= LANE_CHANGE_MIN_ACC_GAIN


@njit(cache=True, nogil=True)
def _sign(number: int) -> int:
    return (number > 0) - (number < 0)


@njit(cache=True, nogil=True, inline="always")
def drive(scene: Scene, me: int, leader: int, leader_m: float) -> float:
    """Return IDM's acceleration on a free road, or behind `leader` (-1: none) at a distance along the route, m/s2."""
    free = _free(scene, me)
    if leader < 0:
        return free
    gap = desired_gap(scene.rows[me], scene.bodies[me], scene.bodies[leader])
    return min(free, free - rules.interaction(gap, leader_m))


@njit(cache=True, nogil=True, inline="always")
def stop_at(scene: Scene, me: int, line_m: float) -> float:
    """Return IDM's acceleration before a stop line, m/s2: as behind a standing vehicle of usual length."""
    body: Body = scene.bodies[me]
    gap = gap_at(scene.rows[me], body, body.speed, rules.VEHICLE_LENGTH_M)
    return _free(scene, me) - rules.interaction(gap, line_m)


@njit(cache=True, nogil=True, inline="always")
def nearest_on_route(scene: Scene, me: int) -> tuple[int, float]:
    """Return the nearest obstacle on the planned route (-1: none), and the distance (m) between middles along it."""
    network, lists, vehicles = scene.network, scene.lists, len(scene.rows)
    vehicle, route = scene.rows[me], scene.routes[me]
    nearest, nearest_m = -1, rules.LOOK_AHEAD_M
    start_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if start_m > nearest_m:
            break
        number = lane_of_route(network, vehicle, route, k)
        lane: LaneRow = network.lanes[number]
        # Where a road ends, a vehicle may stand just beyond.
        end_m = lane.length if network.roads[lane.road].ways > 0 else lane.length + rules.VEHICLE_LENGTH_M
        for entry in range(first_from(lists, number, max(0.0, -start_m)), lists.first[number] + lists.entries[number]):
            along, other = lists.along[entry], lists.body[entry]
            distance_m = start_m + along
            if along > end_m or distance_m >= nearest_m:
                break
            if other == me or distance_m <= 0:
                continue
            drives = other < vehicles
            strange = drives and vehicle.driver == TOWN and scene.rows[other].driver in (PEDALLED, STEERED)
            angle = scene.bodies[other].heading - heading_at(lane, network.corners, along)
            radius_m = radius_at(lane, network.corners, along)
            if _is_in_way(vehicle, scene.bodies[other], drives, strange, angle, radius_m, lists.aside[entry]):
                nearest, nearest_m = other, distance_m
                break
        start_m += lane.length
    return _tail_ahead(scene, me, nearest, nearest_m)


@njit(cache=True, nogil=True)
def _is_in_way(
    vehicle: Vehicle, other: Body, drives: bool, strange: bool, angle: float, radius_m: float, aside: float
) -> bool:
    """Return whether a body is in the way; a `strange` vehicle may come towards or across, whoever has the right.

    `angle` is its heading from the lane's, and `radius_m` that of the bend where it is.
    """
    reach_m = rules.passing_distance(vehicle.width, other.width)
    if drives:
        stands = strange or other.crashed or other.speed < rules.STANDING_M_S
        return rules.is_vehicle_in_way(
            aside, angle, other.length, other.width, stands, reach_m, _swing_in(vehicle, radius_m)
        )
    reach_m += rules.cut_inside_m(vehicle.length, radius_m)
    return rules.is_person_in_way(aside, angle, other.speed, reach_m)


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
        if body.length <= rules.LONG_M or other == me or math.hypot(x - vehicle.x, y - vehicle.y) > nearest_m:
            continue
        end_m = here_m
        for k in range(vehicle.route_length):
            lane: LaneRow = network.lanes[lane_of_route(network, vehicle, route, k)]
            start_m, end_m = end_m, end_m + lane.length
            reach_m = rules.passing_distance(vehicle.width, body.width) + _swing_in(vehicle, lane.radius)
            if distance_to_box(lane, x, y) > reach_m:  # saves time
                continue
            along, aside = local_coordinates(lane, network.corners, x, y)
            distance_m = start_m + along + half_m
            if not (0 <= along <= lane.length and half_m < distance_m < nearest_m):
                continue
            middle_aside = local_coordinates(lane, network.corners, body.x, body.y)[1]
            angle = body.heading - heading_at(lane, network.corners, along)
            swing_m = _swing_in(vehicle, radius_at(lane, network.corners, along))
            reach_m = rules.passing_distance(vehicle.width, body.width) + swing_m
            if rules.is_tail_in_way(aside, angle, middle_aside, reach_m):
                nearest, nearest_m = other, distance_m
    return nearest, nearest_m


@njit(cache=True, nogil=True)
def _swing_in(vehicle: Vehicle, radius_m: float) -> float:
    """Return how far a vehicle swings out in a bend, m."""
    return float(rules.swing_m(vehicle.length, vehicle.axle_m, radius_m))


@njit(cache=True, nogil=True, inline="always")
def _free(scene: Scene, me: int) -> float:
    """Return IDM's acceleration on a free road, towards the speed that the bends ahead allow, m/s2."""
    network, vehicle, route = scene.network, scene.rows[me], scene.routes[me]
    speed = vehicle.target_speed
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        lane: LaneRow = network.lanes[lane_of_route(network, vehicle, route, k)]
        if vehicle.driver != UNYIELDING or lane.kind == CIRCULAR:
            speed = min(speed, rules.approach_speed(lane.speed_limit, distance_m))
        if lane.kind == POLYLINE:
            corners, first = network.corners, lane.first_corner
            speed = min(speed, polyline_speed(corners, first, lane.corners, distance_m, rules.EASY_BRAKING_M_S2))
        distance_m += lane.length
    return free_road(vehicle.speed, speed)
