"""Paths of planners that steer: the route, or a line beside it, and the wheels that follow it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.interfaces.planner import PlannedCar


def steering_angle(car: PlannedCar, look_s: float = 0.6, look_m: float = 4.0) -> float:
    """Return the angle of the front wheels, rad, that leads along the route of a car; see `Route.pursuit_rad`."""
    return car.route.pursuit_rad(car.speed_m_s, car.wheelbase_m, look_s, look_m)


def beside(car: PlannedCar, aside_m: float) -> PlannedCar:
    """Return a car whose route is moved to its left by a distance, m."""
    if aside_m == 0:
        return car
    tangents = car.route.tangents
    left = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    return replace(car, route=replace(car.route, points=car.route.points + aside_m * left))
