"""Steering along a lane, and the bicycle model that moves a vehicle, as in highway-env.

Polack et al., "The kinematic bicycle model: a consistent model for planning feasible trajectories for autonomous
vehicles?", IEEE Intelligent Vehicles Symposium 2017.

highway-env puts the axles at a vehicle's ends and its middle on the lane's. A bus of 12 m would so need a width of
6.5 m in a bend of 16 m. Vehicles that extend beyond their axles lead the front one along the lane instead, which takes
4.8 m.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic import rules
from coopsim.world.traffic.fleet import CHAUFFEURED, STEERED, Body, Vehicle
from coopsim.world.traffic.lane_geometry import closest_lane, heading_at, local_coordinates
from coopsim.world.traffic.lanes import LaneArrays, LaneRow
from coopsim.world.traffic.steered import roll

HEADING_GAIN_1_S = 5.0
SPEED_GAIN_1_S = 1 / 0.6
PURSUIT_S = 0.1
SPEED_MAX_M_S = 40.0


@njit(cache=True, nogil=True)
def steer(lane: LaneRow, corners: NDArray[Any], vehicle: Vehicle) -> float:
    """Return the steering angle that brings a vehicle to the lane's middle line, rad.

    A proportional controller of the place aside sets a speed aside, and so a heading; another one of the heading sets a
    turn rate, and so a steering angle.
    """
    if vehicle.axle_m < vehicle.length / 2:
        return float(_steer_by_front_axle(lane, corners, vehicle))
    along, aside = local_coordinates(lane, corners, vehicle.x, vehicle.y)
    ahead = heading_at(lane, corners, along + vehicle.speed * PURSUIT_S)
    speed = rules.not_zero(vehicle.speed)
    towards = rules.angle_to_lane(aside, vehicle.speed, vehicle.lateral_gain)
    turn_rate = HEADING_GAIN_1_S * rules.wrap(ahead + towards - vehicle.heading)
    slip = math.asin(min(max(vehicle.axle_m / speed * turn_rate, -1.0), 1.0))
    return min(max(math.atan(2 * math.tan(slip)), -rules.STEERING_MAX_RAD), rules.STEERING_MAX_RAD)


@njit(cache=True, nogil=True)
def _steer_by_front_axle(lane: LaneRow, corners: NDArray[Any], vehicle: Vehicle) -> float:
    x = vehicle.x + vehicle.axle_m * math.cos(vehicle.heading)
    y = vehicle.y + vehicle.axle_m * math.sin(vehicle.heading)
    along, aside = local_coordinates(lane, corners, x, y)
    ahead = heading_at(lane, corners, along + vehicle.speed * PURSUIT_S)
    return rules.steer_front_axle(aside, ahead, vehicle.heading, vehicle.speed, vehicle.lateral_gain)


@njit(cache=True, nogil=True)
def move(network: LaneArrays, rows: NDArray[Any], dt_s: float) -> None:
    """Move all vehicles for `dt_s` as they have decided; crashed ones brake to a stop."""
    for k in range(len(rows)):
        vehicle: Vehicle = rows[k]
        _limit(vehicle, dt_s)
        slip = math.atan(math.tan(vehicle.steering) / 2)
        rolls = vehicle.driver == STEERED and not vehicle.crashed
        if rolls:
            roll(vehicle, dt_s)
        else:
            vehicle.x += vehicle.speed * math.cos(vehicle.heading + slip) * dt_s
            vehicle.y += vehicle.speed * math.sin(vehicle.heading + slip) * dt_s
        if vehicle.pushed:
            vehicle.x += vehicle.push_x
            vehicle.y += vehicle.push_y
            vehicle.crashed, vehicle.pushed = True, False
        if not rolls:
            vehicle.heading += vehicle.speed * math.sin(slip) / vehicle.axle_m * dt_s
            vehicle.speed += vehicle.acceleration * dt_s
        vehicle.timer += dt_s
        vehicle.lane = closest_lane(network.lanes, network.corners, vehicle.x, vehicle.y, vehicle.heading, vehicle.lane)


@njit(cache=True, nogil=True)
def _limit(vehicle: Vehicle, dt_s: float) -> None:
    """Limit steering and acceleration to what the vehicle can do."""
    if vehicle.driver not in (CHAUFFEURED, STEERED):
        vehicle.acceleration = rules.without_reversing(vehicle.acceleration, vehicle.speed, dt_s)
    if vehicle.crashed:
        vehicle.steering, vehicle.acceleration = 0.0, -vehicle.speed
    if vehicle.speed > SPEED_MAX_M_S:
        vehicle.acceleration = min(vehicle.acceleration, SPEED_MAX_M_S - vehicle.speed)
    elif vehicle.speed < -SPEED_MAX_M_S:
        vehicle.acceleration = max(vehicle.acceleration, -SPEED_MAX_M_S - vehicle.speed)


def collide(rows: NDArray[Any], bodies: NDArray[Any], dt_s: float) -> None:
    """Mark vehicles that touch a body as crashed; push apart those that overlap now or will within `dt_s`.

    As in highway-env a later pair's push replaces an earlier one's, so pairs come in the order of its loops.
    """
    order = np.argsort(bodies["x"], kind="stable")
    _collide(rows, bodies, np.sort(_near_pairs(bodies, order, len(rows), dt_s)), dt_s)


@njit(cache=True, nogil=True)
def _collide(rows: NDArray[Any], bodies: NDArray[Any], pairs: Ints, dt_s: float) -> None:
    for pair in pairs:
        i, j = pair // len(bodies), pair % len(bodies)
        a, b = bodies[i], bodies[j]
        reach = (math.hypot(a.length, a.width) + math.hypot(b.length, b.width)) / 2 + a.speed * dt_s
        if math.hypot(b.x - a.x, b.y - a.y) > reach:
            continue
        touching, pushing, push_x, push_y = _overlap(a, b, dt_s)
        for k, sign in ((i, 0.5), (j, -0.5)):
            if k < len(rows) and pushing:
                rows[k].pushed, rows[k].push_x, rows[k].push_y = True, sign * push_x, sign * push_y
            if k < len(rows) and touching:
                rows[k].crashed = True


@njit(cache=True, nogil=True)
def _near_pairs(bodies: NDArray[Any], order: Ints, vehicles: int, dt_s: float) -> Ints:
    """Return pairs i < j with at least one vehicle, as i * len(bodies) + j, by a sweep along x in the given order."""
    reach = 0.0
    for body in bodies:
        reach = max(reach, math.hypot(body.length, body.width) + abs(body.speed) * dt_s)
    pairs = [np.int64(0) for _ in range(0)]  # an empty list with a type that the compiler knows
    for k in range(len(order)):
        for later in range(k + 1, len(order)):
            i, j = min(order[k], order[later]), max(order[k], order[later])
            if bodies[order[later]].x - bodies[order[k]].x > reach:
                break
            if i < vehicles and abs(bodies[i].y - bodies[j].y) <= reach:
                pairs.append(i * len(bodies) + j)
    return np.array(pairs, dtype=np.int64)


@njit(cache=True, nogil=True)
def _overlap(a: Body, b: Body, dt_s: float) -> tuple[bool, bool, float, float]:
    """Return whether two rectangles overlap now, and by the end of `dt_s`, and the least move of `a` that parts them.

    The polygon collision detection of highway-env's `utils.are_polygons_intersecting`.
    """
    corners_a, corners_b = _corners(a), _corners(b)
    moved_x = (a.speed * a.dir_x - b.speed * b.dir_x) * dt_s
    moved_y = (a.speed * a.dir_y - b.speed * b.dir_y) * dt_s
    touching, pushing, least, axis_x, axis_y = True, True, math.inf, 0.0, 0.0
    for side in range(8):
        corners = corners_a if side < 4 else corners_b
        edge = corners[(side + 1) % 4] - corners[side % 4]
        length = math.sqrt(edge[0] ** 2 + edge[1] ** 2)
        x, y = -edge[1] / length, edge[0] / length
        low_a, high_a = _extent(corners_a, x, y)
        low_b, high_b = _extent(corners_b, x, y)
        touching = touching and _gap(low_a, high_a, low_b, high_b) <= 0
        moved = x * moved_x + y * moved_y
        gap = _gap(low_a + min(moved, 0.0), high_a + max(moved, 0.0), low_b, high_b)
        pushing = pushing and gap <= 0
        if not touching and not pushing:
            return False, False, 0.0, 0.0
        if abs(gap) < least:
            least = abs(gap)
            sign = 1.0 if (a.x - b.x) * x + (a.y - b.y) * y > 0 else -1.0
            axis_x, axis_y = sign * x, sign * y
    return touching, pushing, least * axis_x, least * axis_y


@njit(cache=True, nogil=True)
def _corners(body: Body) -> Floats:
    """Return the corners (4, 2) in highway-env's order: ties between axes go to the first."""
    half_length, half_width = body.length / 2, body.width / 2
    corners = np.empty((4, 2))
    for k in range(4):
        along = -half_length if k < 2 else half_length
        aside = half_width if 0 < k < 3 else -half_width
        corners[k, 0] = body.x + body.dir_x * along - body.dir_y * aside
        corners[k, 1] = body.y + body.dir_y * along + body.dir_x * aside
    return corners


@njit(cache=True, nogil=True)
def _extent(corners: Floats, x: float, y: float) -> tuple[float, float]:
    """Return the extent of corners along an axis."""
    low, high = math.inf, -math.inf
    for k in range(4):
        along = corners[k, 0] * x + corners[k, 1] * y
        low, high = min(low, along), max(high, along)
    return low, high


@njit(cache=True, nogil=True)
def _gap(low_a: float, high_a: float, low_b: float, high_b: float) -> float:
    """Return the gap between two intervals, negative where they overlap."""
    return low_b - high_a if low_a < low_b else low_a - high_b
