"""Rules of the road in a drive: its goal, red lights, ground that is no road, and lanes that lead the other way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types.driving import NO_LIGHT, RED, CarState

if TYPE_CHECKING:
    from coopsim.metrics.drive_log import Drive

AGAINST_S = 1.0
"""Time over which metres against the traffic are summed: NAVSIM's horizon of driving direction compliance."""


class RuleState(NamedTuple):
    """State of the rules in a frame: one row of `Drive.rules`.

    Attributes:
        completion: share of the way to the goal; NaN: there is no goal.
        arrived: 1 if the goal is reached.
        off_road: 1 if the car's middle is on no road.
        off_area: 1 if that is so, or a corner is on a pavement.
        against: 1 on lanes that all lead the other way.
        front_light: light that holds where the car's front is.
        light: light that holds where its middle is.
    """

    completion: float = math.nan
    arrived: float = 0.0
    off_road: float = 0.0
    off_area: float = 0.0
    against: float = 0.0
    front_light: float = NO_LIGHT
    light: float = NO_LIGHT


def state_of(car: CarState, off_road: bool = False, off_area: bool = False, *, scripted: bool = False) -> RuleState:
    """Return what a car's state, and whether it has left the road and the drivable area, say of the rules.

    A `scripted` situation is over before any goal could be reached: it has none.
    """
    route = car.route
    goal = math.isfinite(route.length_m) and not scripted
    front = light = NO_LIGHT
    if len(route.lights):
        ahead = min(round(car.length_m / 2 / route.spacing_m), len(route.lights) - 1)
        front, light = int(route.lights[ahead]), int(route.lights[0])
    completion = route.completion if goal else math.nan
    arrived = goal and route.arrived and not car.crashed
    return RuleState(completion, arrived, off_road, off_area, car.wrong_way, front, light)


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules that a drive kept and broke, up to its crash or its end.

    Attributes:
        completion: share of the way to the goal that was driven, in [0, 1]; NaN: there is no goal.
        arrived: the goal was reached.
        red_lights: number of red lights that were run: its front passed the line at red, and its middle followed.
        off_road: share of the way with the car's middle on no road.
        off_area: the car left the drivable area.
        against_m: most metres against the traffic within `AGAINST_S`.
    """

    completion: float
    arrived: bool
    red_lights: int
    off_road: float
    off_area: bool
    against_m: float


def find_rules(drive: Drive, end: int) -> Rules:
    """Find what the first `end` frames of a drive say of the rules."""
    if not len(drive.rules) or not end:
        return Rules(math.nan, False, 0, 0.0, False, 0.0)
    state = RuleState(*drive.rules[:end].T)
    step_m = np.hypot(*np.diff(drive.car[:end, :2], axis=0, prepend=drive.car[:1, :2]).T)
    way_m = float(step_m.sum())
    arrived = bool(np.any(state.arrived))
    completion = 1.0 if arrived else float(np.max(state.completion))
    off = float(step_m @ state.off_road) / way_m if way_m > 0 else float(np.max(state.off_road))
    against = _most_within(step_m * state.against, drive.time_s[:end], AGAINST_S)
    reds = _red_lights(np.asarray(state.front_light), np.asarray(state.light))
    return Rules(completion, arrived, reds, off, bool(np.any(state.off_area)), against)


def _most_within(step_m: Floats, time_s: Floats, window_s: float) -> float:
    """Return the largest sum of steps (F,) m that end within `window_s`."""
    passed = np.append(0.0, np.cumsum(step_m))
    first = np.searchsorted(time_s, time_s - window_s + 1e-9, side="right")
    return float((passed[1:] - passed[first]).max())


def _red_lights(front: Floats, middle: Floats) -> int:
    """Count lines that the front passes at red, after which the middle passes them, too."""
    enters = (front[1:] != NO_LIGHT) & (front[:-1] == NO_LIGHT)
    passes = (middle[1:] != NO_LIGHT) & (middle[:-1] == NO_LIGHT)
    count, colour = 0, float(NO_LIGHT)
    for k in np.flatnonzero(enters | passes).tolist():
        colour = float(front[k + 1]) if enters[k] else colour
        if passes[k]:
            count, colour = count + (colour == RED), float(NO_LIGHT)
    return count
