"""Steering along a lane, and the bicycle model that moves a vehicle, as highway-env has them.

Polack et al., "The kinematic bicycle model: a consistent model for planning feasible trajectories for autonomous
vehicles?", IEEE Intelligent Vehicles Symposium 2017.

highway-env has the axles at a vehicle's ends and its middle on the lane's. A bus of 12 m would so need a width of
6.5 m in a bend of 16 m. Whoever reaches beyond its axles leads the front one along the lane instead, which takes
4.8 m: Hoffmann et al., "Autonomous automobile trajectory tracking for off-road driving", American Control Conference
2007, with highway-env's gain and limits.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit
from numpy.typing import NDArray

from coopsim.world.traffic.engine.car_following import not_zero
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, PLAIN, Vehicle
from coopsim.world.traffic.engine.lanes import Lane, closest_lane, heading_at, local_coordinates, wrap

HEADING_GAIN_1_S = 5.0
SPEED_GAIN_1_S = 1 / 0.6
PURSUIT_S = 0.1
STEERING_MAX_RAD = math.pi / 3
SPEED_MAX_M_S = 40.0


@njit(cache=True, nogil=True)
def steer(lane: Lane, vehicle: Vehicle) -> float:
    """Angle of the front wheels, rad, that brings a vehicle to the lane's middle line.

    A proportional controller of the place aside asks for a speed aside, and so for a heading; another of the heading
    asks for a turn rate, and so for a steering angle.
    """
    if vehicle.axle_m < vehicle.length / 2:
        return float(_steer_front_axle(lane, vehicle))
    along, aside = local_coordinates(lane, vehicle.x, vehicle.y)
    ahead = heading_at(lane, along + vehicle.speed * PURSUIT_S)
    speed = not_zero(vehicle.speed)
    turn_rate = HEADING_GAIN_1_S * wrap(ahead + _towards_lane(vehicle, aside) - vehicle.heading)
    slip = math.asin(min(max(vehicle.axle_m / speed * turn_rate, -1.0), 1.0))
    return min(max(math.atan(2 * math.tan(slip)), -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit(cache=True, nogil=True)
def _steer_front_axle(lane: Lane, vehicle: Vehicle) -> float:
    """The front wheels go where the lane does under them, and towards its middle line."""
    x = vehicle.x + vehicle.axle_m * math.cos(vehicle.heading)
    y = vehicle.y + vehicle.axle_m * math.sin(vehicle.heading)
    along, aside = local_coordinates(lane, x, y)
    ahead = heading_at(lane, along + vehicle.speed * PURSUIT_S)
    angle = wrap(ahead + _towards_lane(vehicle, aside) - vehicle.heading)
    return min(max(angle, -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit(cache=True, nogil=True)
def _towards_lane(vehicle: Vehicle, aside: float) -> float:
    """Angle to the lane at which to come back to its middle line, rad."""
    angle = math.asin(min(max(-vehicle.lateral_gain * aside / not_zero(vehicle.speed), -1.0), 1.0))
    return min(max(angle, -math.pi / 4), math.pi / 4)


@njit(cache=True, nogil=True)
def move(lanes: NDArray[Any], rows: NDArray[Any], dt_s: float) -> None:
    """Everybody does as it has decided for `dt_s`; who has crashed brakes to a stop."""
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
    """What a vehicle cannot do, whatever was decided."""
    if vehicle.driver != PLAIN and vehicle.driver != CHAUFFEURED:
        # IDM brakes on after the stop: in a queue highway-env's vehicles creep backwards, and steer while they do.
        vehicle.acceleration = max(vehicle.acceleration, -max(vehicle.speed, 0.0) / dt_s)
    if vehicle.crashed:
        vehicle.steering, vehicle.acceleration = 0.0, -vehicle.speed
    if vehicle.speed > SPEED_MAX_M_S:
        vehicle.acceleration = min(vehicle.acceleration, SPEED_MAX_M_S - vehicle.speed)
    elif vehicle.speed < -SPEED_MAX_M_S:
        vehicle.acceleration = max(vehicle.acceleration, -SPEED_MAX_M_S - vehicle.speed)
