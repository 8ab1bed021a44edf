"""Steering along a lane, and the bicycle model that moves a vehicle, as highway-env has them.

Polack et al., "The kinematic bicycle model: a consistent model for planning feasible trajectories for autonomous
vehicles?", IEEE Intelligent Vehicles Symposium 2017.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit
from numpy.typing import NDArray

from coopsim.world.engine.car_following import not_zero
from coopsim.world.engine.fleet import CHAUFFEURED, PLAIN, Vehicle
from coopsim.world.engine.lanes import Lane, closest_lane, heading_at, local_coordinates, wrap

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
    along, aside = local_coordinates(lane, vehicle.x, vehicle.y)
    ahead = heading_at(lane, along + vehicle.speed * PURSUIT_S)
    speed = not_zero(vehicle.speed)
    towards = math.asin(min(max(-vehicle.lateral_gain * aside / speed, -1.0), 1.0))
    wanted = ahead + min(max(towards, -math.pi / 4), math.pi / 4)
    turn_rate = HEADING_GAIN_1_S * wrap(wanted - vehicle.heading)
    slip = math.asin(min(max(vehicle.length / 2 / speed * turn_rate, -1.0), 1.0))
    return min(max(math.atan(2 * math.tan(slip)), -STEERING_MAX_RAD), STEERING_MAX_RAD)


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
        vehicle.heading += vehicle.speed * math.sin(slip) / (vehicle.length / 2) * dt_s
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
