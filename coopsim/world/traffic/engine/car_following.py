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
from coopsim.world.traffic.engine.fleet import Body, Vehicle
from coopsim.world.traffic.engine.lanes import LaneRow, local_coordinates
from coopsim.world.traffic.engine.neighbours import LaneLists, Scene, behind, in_front
from coopsim.world.traffic.rules.driving import COMFORT_ACC_MAX, MERGE_M, VEHICLE_LENGTH_M, extra_gap, not_zero

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
    dynamic += ego.speed * closing / (2 * math.sqrt(-COMFORT_ACC_MAX * COMFORT_ACC_MIN))
    return DISTANCE_WANTED + dynamic + extra_gap(ego.length, length)


@njit(cache=True, nogil=True)
def free_road(speed: float, target_speed: float) -> float:
    """Return IDM's acceleration with nothing in front, m/s2."""
    return COMFORT_ACC_MAX * (1 - math.pow(max(speed, 0.0) / abs(not_zero(target_speed)), DELTA))


@njit(cache=True, nogil=True)
def acceleration(
    lanes: NDArray[Any], rows: NDArray[Any], bodies: NDArray[Any], driver: Vehicle, ego: int, front: int
) -> float:
    """Return IDM's acceleration of body `ego` behind body `front` (-1: none), m/s2; 0 if `ego` is no vehicle."""
    if ego < 0 or ego >= len(rows):
        return 0.0
    lane: LaneRow = lanes[rows[ego].lane]
    result = free_road(bodies[ego].speed, min(max(rows[ego].target_speed, 0.0), lane.speed_limit))
    if front >= 0:
        gap = desired_gap(driver, bodies[ego], bodies[front])
        distance = distance_along(lane, bodies[ego], bodies[front])
        result -= COMFORT_ACC_MAX * (gap / not_zero(distance)) ** 2
    return result


@njit(cache=True, nogil=True)
def distance_along(lane: LaneRow, ego: Body, other: Body) -> float:
    """Return the distance between the middles of two bodies along a lane, m."""
    return local_coordinates(lane, other.x, other.y)[0] - local_coordinates(lane, ego.x, ego.y)[0]


@njit(cache=True, nogil=True, inline="always")
def follow(scene: Scene, me: int) -> float:
    """Return IDM's acceleration behind the body in front in the own lane and the target lane, m/s2."""
    lanes, rows, vehicle = scene.network.lanes, scene.rows, scene.rows[me]
    result = _follow_on(lanes, rows, scene.bodies, scene.lists, me, vehicle.lane)
    if vehicle.lane != vehicle.target_lane:
        result = min(result, _follow_on(lanes, rows, scene.bodies, scene.lists, me, vehicle.target_lane))
    return result


@njit(cache=True, nogil=True)
def _follow_on(
    lanes: NDArray[Any], rows: NDArray[Any], bodies: NDArray[Any], lists: LaneLists, me: int, lane: int
) -> float:
    along, _ = local_coordinates(lanes[lane], rows[me].x, rows[me].y)
    return acceleration(lanes, rows, bodies, rows[me], me, in_front(lists, lanes, lane, me, along))


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
        if not is_reachable(scene.network.lanes[lane], driver.x, driver.y) or _is_taken(scene, me, lane):
            continue
        if _mobil(scene, me, lane):
            driver.target_lane = lane


@njit(cache=True, nogil=True)
def is_reachable(lane: LaneRow, x: float, y: float) -> bool:
    """Return whether a vehicle at (x, y) may change to the lane."""
    along, aside = local_coordinates(lane, x, y)
    return not lane.forbidden and abs(aside) <= 2 * lane.width and 0 <= along < lane.length + VEHICLE_LENGTH_M


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
            distance = distance_along(here, bodies[me], bodies[k])
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
        if moves_in and abs(distance_along(here, bodies[me], bodies[k])) < MERGE_M:
            return True
    return False


@njit(cache=True, nogil=True, inline="always")
def _mobil(scene: Scene, me: int, lane: int) -> bool:
    """Return whether a lane change is safe for the follower there, and gains enough (highway-env's politeness is 0)."""
    lanes, rows, bodies = scene.network.lanes, scene.rows, scene.bodies
    driver, route = rows[me], scene.routes[me]
    along, _ = local_coordinates(lanes[lane], driver.x, driver.y)
    front = in_front(scene.lists, lanes, lane, me, along)
    follower = behind(scene.lists, lanes, lane, me, along)
    if acceleration(lanes, rows, bodies, driver, follower, me) < -LANE_CHANGE_MAX_BRAKING_IMPOSED:
        return False
    there = acceleration(lanes, rows, bodies, driver, me, front)
    if driver.route_length > 0 and route[0, 1] >= 0:
        number = lanes[driver.target_lane].number
        towards = _sign(lanes[lane].number - number) == _sign(route[0, 1] - number)
        return towards and there >= -LANE_CHANGE_MAX_BRAKING_IMPOSED
    return there - _follow_on(lanes, rows, bodies, scene.lists, me, driver.lane) >= LANE_CHANGE_MIN_ACC_GAIN


@njit(cache=True, nogil=True)
def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
