"""Observations of drivers in `coopsim/drive-v1`: a row of numbers in [-1, 1], in the car's own frame.

| part | numbers | columns |
|---|---|---|
| the car | 8 | `CAR` |
| the route | 10 x 6 | places 5, 10, ... 50 m ahead: `ROUTE` |
| others | 12 x 10 | the nearest road users within 60 m, the nearest first, then zeros: `OTHERS` |

Frame: x forward, y left, origin in the middle of the car. Each number is one in m, m/s, m/s² or rad over its bound, and
taken as the bound where it lies beyond. The route is that of a navigation map. Others are where they are, as with
sensors without errors that see through what is between; policies that perceive drive under `control="steering"`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.types.driving import LARGEST_BRAKING_M_S2, LARGEST_STEERING_RAD, RED, CarState
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import RoadUsers

CAR = ("speed", "acceleration", "steering", "aside", "cos_heading", "sin_heading", "to_go", "time_left")
"""Speed (over 40 m/s), acceleration (8 m/s²), angle of the front wheels (0.6 rad), distance to the left of the route (4
m), heading from that of the route, and shares of the way and of the time that are left."""

ROUTE = ("x", "y", "speed_limit", "right_of_way", "light", "goal")
"""Place (over 60 m), speed limit (40 m/s), -1 to give way and 1 for priority, 0 without a light to 1 at red, and 1 from
the goal on."""

OTHERS = ("x", "y", "vx", "vy", "cos_yaw", "sin_yaw", "length", "width", "on_foot", "there")
"""Middle (over 60 m), velocity over ground (40 m/s), heading, size (20 m and 4 m), 1 for people, and 1."""

POINTS, SPACING_M, NEAREST, REACH_M = 10, 5.0, 12, 60.0
NUMBERS = len(CAR) + POINTS * len(ROUTE) + NEAREST * len(OTHERS)
"""Length of an observation."""

_ROUTE_AT = len(CAR)
_OTHERS_AT = _ROUTE_AT + POINTS * len(ROUTE)
_FASTEST_M_S, _ASIDE_M, _LONGEST_M, _WIDEST_M = 40.0, 4.0, 20.0, 4.0
_PEDESTRIAN, _CHILD = int(ObjectClass.PEDESTRIAN), int(ObjectClass.CHILD)
Observed = NDArray[np.float32]


def observe(car: CarState, me: int, users: RoadUsers, time_left: float) -> Observed:
    """Return the observation (`NUMBERS`,) of a car.

    Args:
        car: the car as it knows itself.
        me: its row among the road users.
        users: everybody, in the world frame.
        time_left: share of its time that is left, in [0, 1].
    """
    row, route = np.zeros(NUMBERS), car.route
    row[:_ROUTE_AT] = _of_car(car, time_left)
    step = round(SPACING_M / route.spacing_m)
    _fill_route(
        row[_ROUTE_AT:_OTHERS_AT].reshape(POINTS, len(ROUTE)),
        route.points,
        route.speed_limit_m_s,
        route.right_of_way,
        route.lights,
        step,
        route.goal_m / route.spacing_m,
    )
    _fill_others(row[_OTHERS_AT:].reshape(NEAREST, len(OTHERS)), me, *users[:5])
    return np.asarray(np.clip(row, -1.0, 1.0, out=row), np.float32)


def _of_car(car: CarState, time_left: float) -> list[float]:
    (x, y), (next_x, next_y) = car.route.points[:2].tolist()
    along_x, along_y = next_x - x, next_y - y
    long = max(math.hypot(along_x, along_y), 1e-9)
    cos, sin = along_x / long, along_y / long
    aside = x * sin - y * cos  # of the car's middle, to the left of the route
    return [
        car.speed_m_s / _FASTEST_M_S,
        car.acceleration_m_s2 / LARGEST_BRAKING_M_S2,
        car.steering_rad / LARGEST_STEERING_RAD,
        aside / _ASIDE_M,
        cos,
        -sin,
        1.0 - car.route.completion,
        time_left,
    ]


@njit(cache=True, nogil=True)
def _fill_route(
    rows: Floats, points: Floats, limit_m_s: Floats, rights: Ints, lights: Ints, step: int, goal: float
) -> None:
    """Fill rows of `ROUTE` from every `step`-th point; `goal` is the place of the goal among the points."""
    for k in range(len(rows)):
        at = min((k + 1) * step, len(points) - 1)
        rows[k, 0], rows[k, 1] = points[at, 0] / REACH_M, points[at, 1] / REACH_M
        rows[k, 2], rows[k, 3] = limit_m_s[at] / _FASTEST_M_S, rights[at]
        rows[k, 4], rows[k, 5] = lights[at] / RED, 1.0 if at >= goal else 0.0


@njit(cache=True, nogil=True)
def _fill_others(
    rows: Floats, me: int, position: Floats, yaw: Floats, velocity: Floats, size: Floats, label: Ints
) -> None:
    """Fill rows of `OTHERS` with the nearest road users, the nearest first; of equally near ones the first counts."""
    apart = np.square(position[:, 0] - position[me, 0]) + np.square(position[:, 1] - position[me, 1])
    apart[me] = np.inf
    cos, sin = math.cos(yaw[me]), math.sin(yaw[me])
    for k in range(min(len(rows), len(apart))):
        n = np.argmin(apart)
        if not apart[n] < REACH_M * REACH_M:
            return
        apart[n] = np.inf
        x, y = position[n, 0] - position[me, 0], position[n, 1] - position[me, 1]
        rows[k, 0], rows[k, 1] = (x * cos + y * sin) / REACH_M, (y * cos - x * sin) / REACH_M
        x, y = velocity[n, 0], velocity[n, 1]
        rows[k, 2], rows[k, 3] = (x * cos + y * sin) / _FASTEST_M_S, (y * cos - x * sin) / _FASTEST_M_S
        rows[k, 4], rows[k, 5] = math.cos(yaw[n] - yaw[me]), math.sin(yaw[n] - yaw[me])
        rows[k, 6], rows[k, 7] = size[n, 0] / _LONGEST_M, size[n, 1] / _WIDEST_M
        rows[k, 8] = 1.0 if label[n] == _PEDESTRIAN or label[n] == _CHILD else 0.0
        rows[k, 9] = 1.0
