"""The intelligent driver model (IDM), and changing lanes by MOBIL, as highway-env has them.

IDM: Treiber, Hennecke and Helbing, "Congested traffic states in empirical observations and microscopic simulations",
Phys. Rev. E 62 (2000). MOBIL: Kesting, Treiber and Helbing, "General lane-changing model MOBIL for car-following
models", Transportation Research Record 1999 (2007).
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit
from numpy.typing import NDArray

from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import HIGHWAY, PLAIN, Body, Vehicle
from coopsim.world.traffic.engine.lanes import VEHICLE_LENGTH_M, Lane, LaneArrays, local_coordinates
from coopsim.world.traffic.engine.neighbours import LaneLists, behind, in_front

ACC_MAX = 6.0  # m/s2; nobody brakes or accelerates harder
COMFORT_ACC_MAX = 3.0
COMFORT_ACC_MIN = -5.0
DISTANCE_WANTED = 10.0  # m, between the middles of two of highway-env's usual vehicles
DELTA = 4.0

LANE_CHANGE_DELAY = 1.0  # s
LANE_CHANGE_MIN_ACC_GAIN = 0.2  # m/s2
LANE_CHANGE_MAX_BRAKING_IMPOSED = 2.0  # m/s2
MERGE_M = 30.0
"""Our highway drivers leave a gap to whoever is about to move into it within this distance."""


@njit(cache=True, nogil=True)
def not_zero(x: float) -> float:
    """At least a hundredth away from zero, on the same side."""
    if abs(x) > 1e-2:
        return x
    return 1e-2 if x >= 0 else -1e-2


@njit(cache=True, nogil=True)
def desired_gap(driver: Vehicle, ego: Body, front: Body) -> float:
    """Between middles, m, as `driver` would keep it in the place of `ego`."""
    closing = ego.speed - front.speed * (front.dir_x * ego.dir_x + front.dir_y * ego.dir_y)
    return gap_at(driver, ego, closing, front.length)


@njit(cache=True, nogil=True)
def gap_at(driver: Vehicle, ego: Body, closing: float, length: float) -> float:
    """The desired gap to something of a length (m) that comes nearer at a speed (m/s)."""
    dynamic = ego.speed * driver.time_wanted
    dynamic += ego.speed * closing / (2 * math.sqrt(-COMFORT_ACC_MAX * COMFORT_ACC_MIN))
    longer = 0.0
    if driver.driver != PLAIN:  # ours keep the jam distance between bumpers whatever the lengths
        longer = max(0.0, (ego.length + length) / 2 - VEHICLE_LENGTH_M)
    return DISTANCE_WANTED + dynamic + longer


@njit(cache=True, nogil=True)
def free_road(speed: float, target_speed: float) -> float:
    """IDM's acceleration without anybody in front, m/s2."""
    return COMFORT_ACC_MAX * (1 - math.pow(max(speed, 0.0) / abs(not_zero(target_speed)), DELTA))


@njit(cache=True, nogil=True)
def acceleration(
    lanes: NDArray[Any], rows: NDArray[Any], bodies: NDArray[Any], driver: Vehicle, ego: int, front: int
) -> float:
    """IDM's for body `ego` behind body `front`, m/s2; 0 for nobody (-1) and for who is no vehicle."""
    if ego < 0 or ego >= len(rows):
        return 0.0
    lane: Lane = lanes[rows[ego].lane]
    result = free_road(bodies[ego].speed, min(max(rows[ego].target_speed, 0.0), lane.speed_limit))
    if front >= 0:
        gap = desired_gap(driver, bodies[ego], bodies[front])
        distance = distance_along(lane, bodies[ego], bodies[front])
        result -= COMFORT_ACC_MAX * (gap / not_zero(distance)) ** 2
    return result


@njit(cache=True, nogil=True)
def distance_along(lane: Lane, ego: Body, other: Body) -> float:
    """From the middle of one to that of the other, m."""
    return local_coordinates(lane, other.x, other.y)[0] - local_coordinates(lane, ego.x, ego.y)[0]


@njit(cache=True, nogil=True)
def follow(network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], lists: LaneLists, me: int) -> float:
    """IDM behind whoever is in front in one's lane and, while changing, in the lane one changes to, m/s2."""
    result = _follow_on(network.lanes, rows, bodies, lists, me, rows[me].lane)
    if rows[me].lane != rows[me].target_lane:
        result = min(result, _follow_on(network.lanes, rows, bodies, lists, me, rows[me].target_lane))
    return result


@njit(cache=True, nogil=True)
def _follow_on(
    lanes: NDArray[Any], rows: NDArray[Any], bodies: NDArray[Any], lists: LaneLists, me: int, lane: int
) -> float:
    along, _ = local_coordinates(lanes[lane], rows[me].x, rows[me].y)
    return acceleration(lanes, rows, bodies, rows[me], me, in_front(lists, lanes, lane, me, along))


@njit(cache=True, nogil=True)
def change_lane(
    network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], lists: LaneLists, routes: Ints, me: int
) -> None:
    """Once in a while, choose a lane beside; give it up if somebody else moves into it just ahead."""
    driver: Vehicle = rows[me]
    if driver.lane != driver.target_lane:
        _give_way(network, rows, bodies, me)
        return
    if driver.timer <= LANE_CHANGE_DELAY:
        return
    driver.timer = 0.0
    here = network.lanes[driver.lane]
    road = network.roads[here.road]
    for number in (here.number - 1, here.number + 1):
        if not 0 <= number < road.lanes or abs(driver.speed) < 1:
            continue
        lane = road.first_lane + number
        if not is_reachable(network.lanes[lane], driver.x, driver.y):
            continue
        if driver.driver == HIGHWAY and _is_taken(network, rows, bodies, me, lane):
            continue
        if _mobil(network, rows, bodies, lists, routes[me], me, lane):
            driver.target_lane = lane


@njit(cache=True, nogil=True)
def is_reachable(lane: Lane, x: float, y: float) -> bool:
    """Whether somebody at (x, y) may change to the lane."""
    along, aside = local_coordinates(lane, x, y)
    return not lane.forbidden and abs(aside) <= 2 * lane.width and 0 <= along < lane.length + VEHICLE_LENGTH_M


@njit(cache=True, nogil=True)
def _give_way(network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], me: int) -> None:
    driver: Vehicle = rows[me]
    here = network.lanes[driver.lane]
    if here.road != network.lanes[driver.target_lane].road:
        return
    for k in range(len(rows)):
        if k != me and rows[k].lane != driver.target_lane and rows[k].target_lane == driver.target_lane:
            distance = distance_along(here, bodies[me], bodies[k])
            if 0 < distance < desired_gap(driver, bodies[me], bodies[k]):
                driver.target_lane = driver.lane
                return


@njit(cache=True, nogil=True)
def _is_taken(network: LaneArrays, rows: NDArray[Any], bodies: NDArray[Any], me: int, lane: int) -> bool:
    """Whether somebody is about to move into the lane close by."""
    here = network.lanes[rows[me].lane]
    for k in range(len(rows)):
        moves_in = k != me and rows[k].target_lane == lane and rows[k].lane != lane
        if moves_in and abs(distance_along(here, bodies[me], bodies[k])) < MERGE_M:
            return True
    return False


@njit(cache=True, nogil=True)
def _mobil(
    network: LaneArrays,
    rows: NDArray[Any],
    bodies: NDArray[Any],
    lists: LaneLists,
    route: Ints,
    me: int,
    lane: int,
) -> bool:
    """Whether changing to the lane is safe for who follows there, and gains enough (highway-env's politeness is 0)."""
    lanes, driver = network.lanes, rows[me]
    along, _ = local_coordinates(lanes[lane], driver.x, driver.y)
    front = in_front(lists, lanes, lane, me, along)
    follower = behind(lists, lanes, lane, me, along)
    if acceleration(lanes, rows, bodies, driver, follower, me) < -LANE_CHANGE_MAX_BRAKING_IMPOSED:
        return False
    there = acceleration(lanes, rows, bodies, driver, me, front)
    if driver.route_length > 0 and route[0, 1] >= 0:
        number = lanes[driver.target_lane].number
        towards = _sign(lanes[lane].number - number) == _sign(route[0, 1] - number)
        return towards and there >= -LANE_CHANGE_MAX_BRAKING_IMPOSED
    return there - _follow_on(lanes, rows, bodies, lists, me, driver.lane) >= LANE_CHANGE_MIN_ACC_GAIN


@njit(cache=True, nogil=True)
def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
