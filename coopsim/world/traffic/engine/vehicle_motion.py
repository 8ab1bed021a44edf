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

from numpy.typing import NDArray

from coopsim.support.kernels import njit
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, Vehicle
from coopsim.world.traffic.engine.lanes import LaneRow, closest_lane, heading_at, local_coordinates
from coopsim.world.traffic.rules.driving import (
    STEERING_MAX_RAD,
    angle_to_lane,
    not_zero,
    steer_front_axle,
    without_reversing,
    wrap,
)

HEADING_GAIN_1_S = 5.0
SPEED_GAIN_1_S = 1 / 0.6
PURSUIT_S = 0.1
SPEED_MAX_M_S = 40.0


@njit(cache=True, nogil=True)
def steer(lane: LaneRow, vehicle: Vehicle) -> float:
    """Return the steering angle that brings a vehicle to the lane's middle line, rad.

    A proportional controller of the place aside sets a speed aside, and so a heading; another one of the heading sets a
    turn rate, and so a steering angle.
    """
    if vehicle.axle_m < vehicle.length / 2:
        return float(_steer_by_front_axle(lane, vehicle))
    along, aside = local_coordinates(lane, vehicle.x, vehicle.y)
    ahead = heading_at(lane, along + vehicle.speed * PURSUIT_S)
    speed = not_zero(vehicle.speed)
    towards = angle_to_lane(aside, vehicle.speed, vehicle.lateral_gain)
    turn_rate = HEADING_GAIN_1_S * wrap(ahead + towards - vehicle.heading)
    slip = math.asin(min(max(vehicle.axle_m / speed * turn_rate, -1.0), 1.0))
    return min(max(math.atan(2 * math.tan(slip)), -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit(cache=True, nogil=True)
def _steer_by_front_axle(lane: LaneRow, vehicle: Vehicle) -> float:
    x = vehicle.x + vehicle.axle_m * math.cos(vehicle.heading)
    y = vehicle.y + vehicle.axle_m * math.sin(vehicle.heading)
    along, aside = local_coordinates(lane, x, y)
    ahead = heading_at(lane, along + vehicle.speed * PURSUIT_S)
    return steer_front_axle(aside, ahead, vehicle.heading, vehicle.speed, vehicle.lateral_gain)


@njit(cache=True, nogil=True)
def move(lanes: NDArray[Any], rows: NDArray[Any], dt_s: float) -> None:
    """Move all vehicles for `dt_s` as they have decided; crashed ones brake to a stop."""
    for k in range(len(rows)):
        vehicle: Vehicle = rows[k]
        _limit(vehicle, dt_s)
        slip = math.atan(math.tan(vehicle.steering) / 2)
        vehicle.x += vehicle.speed * math.cos(vehicle.heading + slip) * dt_s
        vehicle.y += vehicle.speed * math.sin(vehicle.heading + slip) * dt_s
        if vehicle.pushed:
            vehicle.x += vehicle.push_x
            vehicle.y += vehicle.push_y
            vehicle.crashed, vehicle.pushed = True, False
        vehicle.heading += vehicle.speed * math.sin(slip) / vehicle.axle_m * dt_s
        vehicle.speed += vehicle.acceleration * dt_s
        vehicle.timer += dt_s
        vehicle.lane = closest_lane(lanes, vehicle.x, vehicle.y, vehicle.heading, vehicle.lane)


@njit(cache=True, nogil=True)
def _limit(vehicle: Vehicle, dt_s: float) -> None:
    """Limit steering and acceleration to what the vehicle can do."""
    if vehicle.driver != CHAUFFEURED:
        vehicle.acceleration = without_reversing(vehicle.acceleration, vehicle.speed, dt_s)
    if vehicle.crashed:
        vehicle.steering, vehicle.acceleration = 0.0, -vehicle.speed
    if vehicle.speed > SPEED_MAX_M_S:
        vehicle.acceleration = min(vehicle.acceleration, SPEED_MAX_M_S - vehicle.speed)
    elif vehicle.speed < -SPEED_MAX_M_S:
        vehicle.acceleration = max(vehicle.acceleration, -SPEED_MAX_M_S - vehicle.speed)
