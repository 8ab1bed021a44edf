"""Rules of the road in a drive: its goal, red lights, ground that is no road, and lanes that lead the other way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types.driving import CarState

if TYPE_CHECKING:
    from coopsim.metrics.drive_log import Drive

AGAINST_S = 1.0
"""Time over which metres against the traffic are summed: NAVSIM's horizon of driving direction compliance."""

BESIDE_M, BESIDE_S = 0.5, 2.0
"""Distance from the lane's middle, and time without a break, from which on a lane is not kept: NAVSIM's."""


class RuleState(NamedTuple):
    """State of the rules in a frame: one row of `Drive.rules`.

    Attributes:
        completion: share of the way to the goal; NaN: there is no goal.
        arrived: 1 if the goal is reached.
        off_road: 1 if the car's middle is on no road.
        off_area: 1 if that is so, or a corner is on a pavement.
        against: 1 on lanes that all lead the other way.
        red_lights: number of red lights that the car has run so far.
    """

    completion: float = math.nan
    arrived: float = 0.0
    off_road: float = 0.0
    off_area: float = 0.0
    against: float = 0.0
    red_lights: float = 0.0


def state_of(car: CarState, off_road: bool = False, off_area: bool = False, *, scripted: bool = False) -> RuleState:
    """Return what a car's state, and whether it has left the road and the drivable area, say of the rules.

    A `scripted` situation is over before any goal could be reached: it has none.
    """
    route = car.route
    goal = math.isfinite(route.length_m) and not scripted
    completion = route.completion if goal else math.nan
    arrived = goal and route.arrived and not car.crashed
    return RuleState(completion, arrived, off_road, off_area, car.wrong_way, car.red_lights)


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules that a drive kept and broke, up to its crash or its end.

    Attributes:
        completion: share of the way to the goal that was driven, in [0, 1]; NaN: there is no goal.
        arrived: the goal was reached.
        red_lights: number of red lights that were run, see `CarState`.
        off_lanes: share of the way with the car's middle on no road, or on lanes that all lead the other way.
        off_area: the car left the drivable area.
        against_m: most metres against the traffic within `AGAINST_S`.
        beside: share of frames in stretches of at least `BESIDE_S` with the middle more than `BESIDE_M` beside the way.
    """

    completion: float
    arrived: bool
    red_lights: int
    off_lanes: float
    off_area: bool
    against_m: float
    beside: float = 0.0


def find_rules(drive: Drive, end: int) -> Rules:
    """Find what the first `end` frames of a drive say of the rules."""
    if not len(drive.rules) or not end:
        return Rules(math.nan, False, 0, 0.0, False, 0.0)
    state = RuleState(*drive.rules[:end].T)
    step_m = np.hypot(*np.diff(drive.car[:end, :2], axis=0, prepend=drive.car[:1, :2]).T)
    way_m = float(step_m.sum())
    arrived = bool(np.any(state.arrived))
    completion = 1.0 if arrived else float(np.max(state.completion))
    outside = np.maximum(state.off_road, state.against)
    off = float(step_m @ outside) / way_m if way_m > 0 else float(np.max(outside))
    against = _most_within(step_m * state.against, drive.time_s[:end], AGAINST_S)
    reds, beside = int(np.max(state.red_lights)), _long_beside(drive, end)
    return Rules(completion, arrived, reds, off, bool(np.any(state.off_area)), against, beside)


def _long_beside(drive: Drive, end: int) -> float:
    """Return `Rules.beside` of the first `end` frames."""
    first, then = np.array([way.points[:2] for way in drive.ways[:end]]).transpose(1, 0, 2)
    (along_x, along_y), (x, y) = (then - first).T, (drive.car[:end, :2] - first).T
    beside = np.abs(along_x * y - along_y * x) > BESIDE_M * np.maximum(np.hypot(along_x, along_y), 1e-9)
    begins, ends = np.flatnonzero(np.diff(beside, prepend=False, append=False)).reshape(-1, 2).T
    dt_s = float(np.median(np.diff(drive.time_s))) if len(drive) > 1 else BESIDE_S
    lasts = ends - begins
    return float(lasts[lasts * dt_s > BESIDE_S - 1e-6].sum() / end)


def _most_within(step_m: Floats, time_s: Floats, window_s: float) -> float:
    """Return the largest sum of steps (F,) m that end within `window_s`."""
    passed = np.append(0.0, np.cumsum(step_m))
    first = np.searchsorted(time_s, time_s - window_s + 1e-9, side="right")
    return float((passed[1:] - passed[first]).max())
