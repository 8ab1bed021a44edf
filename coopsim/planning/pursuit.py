"""Paths of planners that steer: the route, or a line beside it, and the wheels that follow it.

Pure pursuit: the rear axle goes along the circle that leads to a place ahead on the path (Coulter, "Implementation of
the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from coopsim.interfaces.planner import PlannedCar
from coopsim.types.driving import LARGEST_STEERING_RAD


def steering_angle(car: PlannedCar, look_s: float = 0.6, look_m: float = 4.0) -> float:
    """Return the angle of the front wheels, rad, that leads along the route of a car.

    Args:
        car: the car.
        look_s: time to the place that it steers to; ours: less swings with the lag of the wheels, more cuts corners.
        look_m: least distance to that place; ours.
    """
    ahead_m = max(look_s * car.speed_m_s, look_m)
    place = min(round(ahead_m / car.route.spacing_m), len(car.route.points) - 1)
    x, y = car.route.points[place].tolist()
    x += car.wheelbase_m / 2  # from the rear axle
    angle = math.atan(2 * y / max(x * x + y * y, 1e-9) * car.wheelbase_m)
    return min(max(angle, -LARGEST_STEERING_RAD), LARGEST_STEERING_RAD)


def beside(car: PlannedCar, aside_m: float) -> PlannedCar:
    """Return a car whose route is moved to its left by a distance, m."""
    if aside_m == 0:
        return car
    tangents = car.route.tangents
    left = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    return replace(car, route=replace(car.route, points=car.route.points + aside_m * left))
