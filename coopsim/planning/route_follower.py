"""A planner that steers along its route, changes lanes, and evades where braking alone does not help.

It accelerates and brakes as `idm_aeb` does, along the line that it steers to.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from coopsim.interfaces.planner import PLANNERS, PlannedCar
from coopsim.planning.evasion import EVADES_M_S2, bounds_m, shift_without_touch
from coopsim.planning.idm_aeb import STANDS_M_S, IdmAeb
from coopsim.planning.lane_choice import Lanes, gain_of_change, room_m
from coopsim.planning.pursuit import beside, steering_angle
from coopsim.planning.told_ways import Known
from coopsim.support.checks import require_flag, require_positive
from coopsim.types import NS_PER_S
from coopsim.types.driving import LARGEST_BRAKING_M_S2

_PATIENCE_S, _CLEAR_M = 3.0, 12.0
_SHIFTS_M = (0.0, 0.5, -0.5, 1.0, -1.0, 1.5, -1.5)
"""Time for which a car stands before it passes what stands beside, the way that must be free, and the lines; ours."""


_EVADED_S = 2.0
"""Time for which it keeps to the line on which it evades; ours."""


@PLANNERS.register("route_follower")
@dataclass(kw_only=True, eq=False)
class RouteFollower(IdmAeb):
    """Steer along the route by pure pursuit, change lanes by MOBIL, evade in an emergency; the rest is `IdmAeb`'s.

    Attributes:
        look_s: time to the place that it steers to; ours: less swings with the lag of the wheels, more cuts corners.
        look_m: least distance to that place; ours.
        aside_m_s: speed to the side of a lane change, which so takes 3 to 4 s; ours.
        changes_lanes: it overtakes on lanes beside its route's.
        evades: it steers around what braking alone would hit.
    """

    steers: ClassVar[bool] = True
    look_s: float = 0.6
    look_m: float = 4.0
    aside_m_s: float = 1.0
    changes_lanes: bool = True
    evades: bool = True

    _lane: int = field(default=0, init=False, repr=False)
    _aside_m: float = field(default=0.0, init=False, repr=False)
    _changed_ns: int = field(default=0, init=False, repr=False)
    _shift_m: float = field(default=0.0, init=False, repr=False)
    _moved_ns: int = field(default=0, init=False, repr=False)
    _evaded_ns: int | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(look_s=self.look_s, look_m=self.look_m, aside_m_s=self.aside_m_s)
        require_flag(changes_lanes=self.changes_lanes, evades=self.evades)

    def plan(self, car: PlannedCar) -> tuple[float, float]:  # type: ignore[override]  # it steers, too
        car, learned = self._perceive(car)
        if self.changes_lanes:
            self._choose_lane(car, learned)
            car = self._within_lane(car)
        there_m = self._lane * _width_m(car)
        there_m += self._around_m(car, learned, there_m)
        step_m = self.aside_m_s * car.dt_s
        self._aside_m += min(max(there_m - self._aside_m, -step_m), step_m)
        path = beside(car, self._aside_m)
        way = self._way(path, learned)
        if self._must_brake(path, way):
            return self._escape(car, learned)
        acceleration = self._along(path, way)
        if self._aside_m != there_m:  # both lanes count while it changes
            target = beside(car, there_m)
            acceleration = min(acceleration, self._along(target, self._way(target, learned)))
        return acceleration, steering_angle(path, self.look_s, self.look_m)

    def _within_lane(self, car: PlannedCar) -> PlannedCar:
        """Return a car that has to stop before its lane ends, where it is beside the route's."""
        if not self._lane:
            return car
        limits = car.route.speed_limit_m_s.copy()
        ends_m = room_m(car.route, self._lane) - car.length_m
        limits[np.arange(len(limits)) * car.route.spacing_m >= ends_m] = 0.0
        return replace(car, route=replace(car.route, speed_limit_m_s=limits))

    def _choose_lane(self, car: PlannedCar, learned: Known) -> None:
        """Choose the lane beside if that gains enough (MOBIL), or must be for the route."""
        settled = abs(self._aside_m - self._lane * _width_m(car)) < self.aside_m_s * car.dt_s
        waited_s = (car.time_ns - self._changed_ns) / NS_PER_S
        lanes = Lanes.around(car.route, self._lane, car.speed_m_s)
        if not settled or waited_s < 1.0 or not lanes.reachable:
            return
        here = beside(car, self._lane * _width_m(car))
        own = here, self._way(here, learned)
        for lane in lanes.reachable:
            there = beside(car, lane * _width_m(car))
            gain = gain_of_change(self, own, (there, self._way(there, learned)))
            if gain > lanes.threshold_m_s2(lane):
                self._lane, self._changed_ns = lane, car.time_ns
                return

    def _around_m(self, car: PlannedCar, learned: Known, lane_m: float) -> float:
        """Return how far beside the middle of its lane a car passes what stands partly in its way, m.

        Cars that met on a junction, where nobody has the right of way, would wait for each other for ever.
        """
        if self._evaded_ns is not None and car.time_ns - self._evaded_ns < _EVADED_S * NS_PER_S:
            return self._shift_m
        if car.speed_m_s > STANDS_M_S:
            self._moved_ns = car.time_ns
        elif car.time_ns - self._moved_ns > _PATIENCE_S * NS_PER_S:
            low_m, high_m = bounds_m(car)
            shifts = [each for each in _SHIFTS_M if low_m <= lane_m + each <= high_m]
            self._shift_m = next((each for each in shifts if not self._blocked(car, learned, lane_m + each)), 0.0)
        if self._shift_m and not self._blocked(car, learned, lane_m):
            self._shift_m = 0.0
        return self._shift_m

    def _blocked(self, car: PlannedCar, learned: Known, aside_m: float) -> bool:
        """Return whether something stands on the next metres of a line beside the route."""
        way = self._way(beside(car, aside_m), learned)
        near = (way.front[0] > -car.length_m / 2) & (way.rear[0] < _CLEAR_M)
        return bool((way.inside[0] & near & (way.speed < STANDS_M_S)).any())

    def _escape(self, car: PlannedCar, learned: Known) -> tuple[float, float]:
        """Return full braking, or a little less with a line beside if braking alone would hit something."""
        shift_m, at_m = 0.0, float(car.route.place(np.zeros((1, 2)))[1][0])
        if self.evades:
            shift_m = shift_without_touch(car, at_m, lambda aside_m: self._way(beside(car, aside_m), learned))
        if shift_m:
            self._aside_m, self._evaded_ns = at_m + shift_m, car.time_ns
            self._shift_m = self._aside_m - self._lane * _width_m(car)
        braking = EVADES_M_S2 if shift_m else LARGEST_BRAKING_M_S2
        return -braking, steering_angle(beside(car, self._aside_m), self.look_s, self.look_m)


def _width_m(car: PlannedCar) -> float:
    return float(car.route.lane_width_m[0]) if len(car.route.lane_width_m) else 0.0
