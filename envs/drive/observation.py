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
from coopsim.types.driving import LARGEST_BRAKING_M_S2, LARGEST_STEERING_RAD, RED, CarState, Route
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import Actors

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

_FASTEST_M_S, _ASIDE_M, _LONGEST_M, _WIDEST_M = 40.0, 4.0, 20.0, 4.0
Observed = NDArray[np.float32]


def observe(car: CarState, pose: tuple[float, float, float], me: int, actors: Actors, time_left: float) -> Observed:
    """Return the observation (`NUMBERS`,) of a car.

    Args:
        car: the car as it knows itself.
        pose: its x and y, m, and heading, rad, in the world frame.
        me: its id among the actors.
        actors: everybody, in the world frame.
        time_left: share of its time that is left, in [0, 1].
    """
    parts = [_of_car(car, time_left), _of_route(car.route).ravel(), _of_others(pose, me, actors).ravel()]
    row: Observed = np.clip(np.concatenate(parts), -1.0, 1.0).astype(np.float32)
    return row


def _of_car(car: CarState, time_left: float) -> Floats:
    (x, y), (next_x, next_y) = car.route.points[:2].tolist()
    along_x, along_y = next_x - x, next_y - y
    long = max(math.hypot(along_x, along_y), 1e-9)
    cos, sin = along_x / long, along_y / long
    aside = x * sin - y * cos  # of the car's middle, to the left of the route
    return np.array(
        [
            car.speed_m_s / _FASTEST_M_S,
            car.acceleration_m_s2 / LARGEST_BRAKING_M_S2,
            car.steering_rad / LARGEST_STEERING_RAD,
            aside / _ASIDE_M,
            cos,
            -sin,
            1.0 - car.route.completion,
            time_left,
        ]
    )


def _of_route(route: Route) -> Floats:
    at = np.arange(1, POINTS + 1) * round(SPACING_M / route.spacing_m)
    at = np.minimum(at, len(route.points) - 1)
    rows = np.empty((POINTS, len(ROUTE)))
    rows[:, :2] = route.points[at] / REACH_M
    rows[:, 2] = route.speed_limit_m_s[at] / _FASTEST_M_S
    rows[:, 3], rows[:, 4] = route.right_of_way[at], route.lights[at] / RED
    rows[:, 5] = at * route.spacing_m >= route.goal_m
    return rows


def _of_others(pose: tuple[float, float, float], me: int, actors: Actors) -> Floats:
    """Return the nearest road users as rows (`NEAREST`, 10) of `OTHERS`."""
    x, y, heading = pose
    offset = actors.boxes.center[:, :2] - [x, y]
    apart = np.square(offset).sum(axis=1)
    near = np.flatnonzero((apart < REACH_M * REACH_M) & (actors.id != me))
    near = near[np.argsort(apart[near], kind="stable")[:NEAREST]]
    cos, sin = math.cos(heading), math.sin(heading)
    turn, yaw = np.array([[cos, -sin], [sin, cos]]), actors.boxes.yaw[near] - heading
    rows = np.zeros((NEAREST, len(OTHERS)))
    rows[: len(near), :2] = offset[near] @ turn / REACH_M
    rows[: len(near), 2:4] = actors.velocity[near] @ turn / _FASTEST_M_S
    rows[: len(near), 4], rows[: len(near), 5] = np.cos(yaw), np.sin(yaw)
    rows[: len(near), 6:8] = actors.boxes.size[near, :2] / [_LONGEST_M, _WIDEST_M]
    label = actors.label[near]
    rows[: len(near), 8] = (label == ObjectClass.PEDESTRIAN) | (label == ObjectClass.CHILD)
    rows[: len(near), 9] = 1.0
    return rows
