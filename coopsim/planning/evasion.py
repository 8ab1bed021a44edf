"""Evasion as a last resort: a line beside the own one on which nothing is hit, within the lanes of the road."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from coopsim.interfaces.planner import PlannedCar
from coopsim.planning.idm_aeb import Occupied, moved_m
from coopsim.types.driving import LARGEST_BRAKING_M_S2

EVADES_M_S2 = 6.0
"""Braking while the car evades: full braking leaves tyres on a dry road 2 m/s² to the side, this leaves 5.8 m/s²."""

_ASIDE_M_S2, _BEGINS_S = 4.0, 0.3
"""Acceleration to the side, the lateral one that few drivers exceed, and the lag of the wheels before it."""

_STEP_M, _MOST_M = 0.5, 3.0
_BEYOND_M = 0.3  # by which the body may leave its lanes


def shift_without_touch(car: PlannedCar, at_m: float, ways: Callable[[float], Occupied]) -> float:
    """Return the least way to the side, m to the left, on which a car that brakes hits nothing; 0: none, or no need.

    Args:
        car: the car, with its route.
        at_m: place of the car to the left of its route.
        ways: function that returns the part that tracks occupy of the line at a distance left of the route, m.
    """
    most = round(_MOST_M / _STEP_M)
    lines = [ways(at_m + k * _STEP_M) for k in range(-most, most + 1)]
    low_m, high_m = bounds_m(car)
    if not _hits(car, lines, 0, LARGEST_BRAKING_M_S2):
        return 0.0
    for steps in sorted(range(-most, most + 1), key=abs)[1:]:
        if low_m <= at_m + steps * _STEP_M <= high_m and not _hits(car, lines, steps, EVADES_M_S2):
            return steps * _STEP_M
    return 0.0


def _hits(car: PlannedCar, lines: Sequence[Occupied], steps: int, braking_m_s2: float) -> bool:
    """Return whether a car that brakes, and goes over to a line, touches a track; the present line is in the middle."""
    times, half_m = lines[0].times, car.length_m / 2
    along = moved_m(car, -braking_m_s2, times)[:, None]
    touches = [(way.touched & (way.rear < along + half_m) & (way.front > along - half_m)).any(axis=1) for way in lines]
    gone_m = _ASIDE_M_S2 / 2 * np.maximum(times - _BEGINS_S, 0.0) ** 2
    line = len(lines) // 2 + np.sign(steps) * np.rint(np.minimum(gone_m / _STEP_M, abs(steps))).astype(int)
    return bool(np.stack(touches)[line, np.arange(len(times))].any())


def bounds_m(car: PlannedCar) -> tuple[float, float]:
    """Return how far to the right (negative) and to the left of its route the middle of a car may go, m."""
    if not len(car.route.lane_width_m):
        return 0.0, 0.0
    width_m, own_m = float(car.route.lane_width_m[0]), float(car.route.lane_width_m[0]) - car.width_m
    left, right = car.route.beside[0].tolist() if len(car.route.beside) else (0, 0)
    return -own_m / 2 - _BEYOND_M - right * width_m, own_m / 2 + _BEYOND_M + left * width_m
