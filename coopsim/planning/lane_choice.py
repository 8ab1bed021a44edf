"""The choice of a lane by MOBIL, within what the route allows.

Kesting, Treiber and Helbing, "General lane-changing model MOBIL for car-following models", Transportation Research
Record 1999 (2007): a change must be safe for the follower in the new lane (eq. 2), and gain more than it costs others
(eq. 7, with a bias, here towards the lane of the route instead of the right one). Accelerations are the planner's own,
by the tracks that it has.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from coopsim.interfaces.planner import PlannedCar
from coopsim.types.driving import Route

if TYPE_CHECKING:
    from coopsim.planning.idm_aeb import IdmAeb, Occupied

POLITENESS = 0.5
"""Weight of what others lose; the paper takes up to 0.5 to be realistic."""

THRESHOLD_M_S2, BIAS_M_S2 = 0.2, 0.3
"""Least gain, highway-env's, as the paper's 0.1 follows noise of tracks; and bias to the lane of the route, the
paper's to the right one."""

SAFE_M_S2 = 2.0
"""Hardest braking of a follower in the new lane: highway-env's. The paper's 4 m/s² are an upper bound on highways."""

_LEAVES_S, _LEAVES_M = 8.0, 60.0  # time and way that a lane must last for a change to it and back; ours
_RETURNS_S, _RETURNS_M = 5.0, 30.0  # and from which on the car goes back to that of its route; ours


def room_m(route: Route, lane: int) -> float:
    """Return how far there is a lane beside the route's, m: to its left by its number, to its right by a negative one.

    The lane of the route itself, 0, and one that lasts as far as the route is known go on: infinite.
    """
    if lane == 0:
        return math.inf
    ends = np.flatnonzero(route.beside[:, 0 if lane > 0 else 1] < abs(lane)) if len(route.beside) else np.zeros(1)
    return min(float(ends[0]) * route.spacing_m if len(ends) else math.inf, route.goal_m)


class Lanes(NamedTuple):
    """Lanes that a car may choose, by their numbers from the route's, and its own.

    Attributes:
        own: the present lane.
        reachable: lanes beside it that last long enough.
        must: it has to go back to the lane of its route.
    """

    own: int
    reachable: tuple[int, ...]
    must: bool

    @classmethod
    def around(cls, route: Route, own: int, speed_m_s: float) -> Lanes:
        """Return the choice of a car with a speed (m/s) in its `own` lane."""
        towards = own - (own > 0) + (own < 0)
        if room_m(route, own) < _RETURNS_S * speed_m_s + _RETURNS_M:
            return cls(own, (towards,), True)
        least_m = max(_LEAVES_S * speed_m_s, _LEAVES_M)
        lanes = [lane for lane in (own + 1, own - 1) if lane == towards or room_m(route, lane) >= least_m]
        return cls(own, tuple(lanes), False)

    def threshold_m_s2(self, lane: int) -> float:
        """Return the least gain of a change to a lane, m/s²."""
        if self.must:
            return -math.inf
        return THRESHOLD_M_S2 + (BIAS_M_S2 if abs(lane) > abs(self.own) else -BIAS_M_S2)


def gain_of_change(planner: IdmAeb, own: tuple[PlannedCar, Occupied], there: tuple[PlannedCar, Occupied]) -> float:
    """Return what a change gains by MOBIL, m/s², for the car and those behind; NaN where it is not safe.

    Args:
        planner: has the model of driving.
        own: the car on its present lane, and what tracks occupy of that.
        there: the car on the new lane, and what tracks occupy of that.
    """
    car, half_m = own[0], own[0].length_m / 2
    beside = there[1].inside[0] & (there[1].rear[0] < half_m) & (there[1].front[0] > -half_m)
    if beside.any():
        return math.nan
    follower, loses = _cost_behind(planner, *there)
    if follower < -SAFE_M_S2 or planner.behind_leaders(*there) < -SAFE_M_S2:
        return math.nan
    _, wins = _cost_behind(planner, *own)
    gain = planner.behind_leaders(*there) - planner.behind_leaders(car, own[1])
    return gain - POLITENESS * (loses - wins)


def _cost_behind(planner: IdmAeb, car: PlannedCar, way: Occupied) -> tuple[float, float]:
    """Return the acceleration of the follower behind the car in a lane, m/s², and what the car costs it there."""
    half_m = car.length_m / 2
    behind = way.inside[0] & (way.front[0] <= -half_m) & way.goes_along
    if not behind.any():
        return 0.0, 0.0
    at = int(np.argmax(np.where(behind, way.front[0], -np.inf)))
    speed = max(float(way.speed_along[at]), 0.0)
    follower = replace(car, speed_m_s=speed)
    ahead = way.inside[0] & way.goes_along & (way.rear[0] > half_m)
    with_car = planner.follows(follower, -half_m - way.front[0, at : at + 1], np.array([car.speed_m_s]))
    without = planner.follows(follower, way.rear[0][ahead] - way.front[0, at], np.maximum(way.speed_along[ahead], 0.0))
    return with_car, without - min(with_car, without)
