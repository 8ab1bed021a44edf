"""Driving: the maneuvers, accelerations and steering angles of actions, and the way ahead of a car."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import freeze
from coopsim.support.kernels import njit
from coopsim.types.units import Ints

Command = int | float | tuple[float, float]
"""Command of an agent to its car: a maneuver, an acceleration in m/s², or that and a steering angle in rad."""


def acceleration_of(command: Command) -> float:
    """Return the acceleration of a command that has one, m/s²."""
    return float(command[0] if isinstance(command, tuple) else command)


MANEUVER, ACCELERATION, STEERING = "maneuver", "acceleration_m_s2", "steering"
"""Parts of an action by which an agent drives; see `AgentSpec.command`."""

GIVES_WAY, NOBODY_FIRST, HAS_PRIORITY = -1, 0, 1
"""Right of way on a piece of a route: others go first; whoever comes first goes first; the car itself goes first."""

OUTER_SIDES = {"right": -1, "left": 1}
"""Sides of the road that vehicles keep to, and on which side of a lane the kerb then is: 1 is the left."""

LARGEST_BRAKING_M_S2, LARGEST_ACCELERATION_M_S2 = 8.0, 3.0
"""Bounds of commanded accelerations: full braking of a passenger car on a dry road, and brisk acceleration."""

LARGEST_STEERING_RAD = 0.6
"""Bound of commanded angles of the front wheels, to the left and to the right: a turning circle of 11 m from kerb to
kerb, as passenger cars have, needs as much at a wheelbase of 2.7 m."""

NO_LIGHT, GREEN, YELLOW, RED = range(4)
"""Traffic light that holds for a piece of a route."""

ARRIVES_M = 5.0
"""Distance along the lanes from which on a goal is reached."""

STRAYS_M = 30.0
"""Distance at which a car has left its route; the CARLA leaderboard's."""

JERK_M_S3 = 40.0
"""Fastest change of a car's acceleration: hydraulic brakes reach full braking 0.2 s after it is asked for."""


def approached(before_m_s2: float, wanted_m_s2: float, dt_s: float) -> float:
    """Return the acceleration a time after it was another one, as near to the one that is wanted as it can be then."""
    change_m_s2 = JERK_M_S3 * dt_s
    return before_m_s2 + min(max(wanted_m_s2 - before_m_s2, -change_m_s2), change_m_s2)


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """The way ahead of a car: points of the middle of its lanes, in the car's base frame, at equal distances.

    Attributes:
        points: (K, 2) m, K >= 2; the first is the one nearest to the car's middle.
        spacing_m: distance from each point to the next, along the lanes.
        speed_limit_m_s: (K,) legal speed, or less where a bend is too narrow for it; 0 from a red light on.
        right_of_way: (K,) `GIVES_WAY`, `NOBODY_FIRST` or `HAS_PRIORITY`.
        lane_width_m: (K,) width of the lane; empty: unknown.
        beside: (K, 2) numbers of lanes of the same road to its left and to its right; empty: unknown.
        lights: (K,) `NO_LIGHT`, `GREEN`, `YELLOW` or `RED` of the way over a junction, from its line on; empty: none.
        goal_m: distance along the lanes to the goal; infinite: there is none.
        length_m: distance along the lanes from the start to the goal; infinite: there is none.
    """

    points: Floats
    spacing_m: float
    speed_limit_m_s: Floats
    right_of_way: Ints
    lane_width_m: Floats = field(default_factory=lambda: np.zeros(0))
    beside: Ints = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    lights: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    goal_m: float = math.inf
    length_m: float = math.inf

    def __post_init__(self) -> None:
        count = len(self.points)
        freeze(
            self,
            points=((count, 2), np.float64),
            speed_limit_m_s=((count,), np.float64),
            right_of_way=((count,), np.int64),
            lane_width_m=((count if len(self.lane_width_m) else 0,), np.float64),
            beside=((count if len(self.beside) else 0, 2), np.int64),
            lights=((count if len(self.lights) else 0,), np.int64),
        )

    @property
    def completion(self) -> float:
        """Share of the way to the goal that is behind the car, in [0, 1]; 0 without a goal."""
        return 0.0 if math.isinf(self.length_m) else min(max(1.0 - self.goal_m / self.length_m, 0.0), 1.0)

    @property
    def arrived(self) -> bool:
        """Flag of a reached goal: it is at most 5 m ahead (as in MetaDrive), and the car is on its lane there."""
        return bool(self.goal_m <= ARRIVES_M and math.hypot(*self.points[0]) <= self.lane_width_m[0])

    @property
    def strayed(self) -> bool:
        """Flag of a route that the car has left: its nearest place is more than 30 m away."""
        return math.hypot(*self.points[0].tolist()) > STRAYS_M

    @property
    def tangents(self) -> Floats:
        """Unit vectors (K, 2) along the route."""
        steps = np.diff(self.points, axis=0, append=2 * self.points[-1:] - self.points[-2:-1])
        unit: Floats = steps / np.maximum(np.hypot(steps[:, 0], steps[:, 1]), 1e-9)[:, None]
        return unit

    def pursuit_rad(self, speed_m_s: float, wheelbase_m: float, look_s: float = 0.6, look_m: float = 4.0) -> float:
        """Return the angle of the front wheels that leads a car along the way, rad, by pure pursuit.

        The rear axle goes along the circle that leads to a place ahead (Coulter, "Implementation of the Pure Pursuit
        Path Tracking Algorithm", CMU-RI-TR-92-01, 1992).

        Args:
            speed_m_s: the car's speed.
            wheelbase_m: distance between its axles.
            look_s: time to that place; ours: less swings with the lag of the wheels, more cuts corners.
            look_m: least distance to it; ours.
        """
        ahead = round(max(look_s * speed_m_s, look_m) / self.spacing_m)
        x, y = self.points[min(ahead, len(self.points) - 1)].tolist()
        x += wheelbase_m / 2  # from the rear axle
        angle = math.atan(2 * y / max(x * x + y * y, 1e-9) * wheelbase_m)
        return min(max(angle, -LARGEST_STEERING_RAD), LARGEST_STEERING_RAD)

    def place(self, points: Floats) -> tuple[Floats, Floats, Ints]:
        """Return the distance along the route (M,) m, that to its left (M,) m, and the nearest point (M,) of places.

        Args:
            points: (M, 2) m in the car's base frame.
        """
        along, aside, nearest = _place(np.ascontiguousarray(points), self.points, self.spacing_m)
        return along, aside, nearest


@njit(cache=True, nogil=True)
def _place(points: Floats, line: Floats, spacing_m: float) -> tuple[Floats, Floats, Ints]:
    """Return the distances (M,) along a line (K, 2) and to its left, and the nearest points (M,), for points (M, 2).

    Of equally near points the first counts. Beyond its last point the line goes straight on, see `Route.tangents`.
    """
    along, aside, nearest = np.empty(len(points)), np.empty(len(points)), np.zeros(len(points), np.int64)
    last = len(line) - 1
    for m in range(len(points)):
        least = np.inf
        for k in range(len(line)):
            x, y = points[m, 0] - line[k, 0], points[m, 1] - line[k, 1]
            apart = x * x + y * y
            if apart < least:
                least, nearest[m] = apart, k
        at = nearest[m]
        if at < last:
            x, y = line[at + 1, 0] - line[at, 0], line[at + 1, 1] - line[at, 1]
        else:
            x, y = 2 * line[at, 0] - line[at - 1, 0] - line[at, 0], 2 * line[at, 1] - line[at - 1, 1] - line[at, 1]
        long = max(math.hypot(x, y), 1e-9)
        x, y = x / long, y / long
        right, up = points[m, 0] - line[at, 0], points[m, 1] - line[at, 1]
        along[m] = at * spacing_m + (right * x + up * y)
        aside[m] = x * up - y * right
    return along, aside, nearest


@dataclass(frozen=True, slots=True, eq=False)
class CarState:
    """State of a car as it knows it by itself.

    Attributes:
        speed_m_s: along its heading.
        acceleration_m_s2: in the last step.
        length_m: length of its body.
        width_m: width of its body.
        crashed: whether it has touched something, and stays.
        route: the way ahead.
        traffic_side: side of the road that vehicles keep to, "right" or "left".
        hit_by_log: whether what it touched first follows a log, which cannot see the car, and drove into it.
        steering_rad: angle of the front wheels, positive to the left; 0 for a car that nobody steers.
        wheelbase_m: distance between the axles, of which the middle is the car's; 0 for a car that nobody steers.
        wrong_way: whether a steered car is on lanes that all lead the other way.
        red_lights: number of red lights that it has run so far.
    """

    speed_m_s: float
    acceleration_m_s2: float
    length_m: float
    width_m: float
    crashed: bool
    route: Route
    traffic_side: str = "right"
    hit_by_log: bool = False
    steering_rad: float = 0.0
    wheelbase_m: float = 0.0
    wrong_way: bool = False
    red_lights: int = 0
