"""A planner that also slows before what nobody sees: from behind each corner somebody might come.

It follows "Occlusion-Aware Risk Assessment for Autonomous Driving in Urban Environments" (Yu, Vasudevan and
Johnson-Roberson, IEEE Robotics and Automation Letters 4, 2019) in that it thinks of people and vehicles in all hidden
places, and the set-based view of Koschi and Althoff ("Set-Based Prediction of Traffic Participants Considering
Occlusions and Traffic Rules", IEEE Transactions on Intelligent Vehicles 6, 2021) in that it drives so that it can stop
for each of them, or has passed before. A place is hidden where the line to the car, and to each agent whose message has
just arrived, is cut by a wall of the map or by a track that stands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import PLANNERS, Occlusions, PlannedCar
from coopsim.planning.hidden import hidden, sides
from coopsim.planning.idm_aeb import ON_FOOT
from coopsim.planning.route_follower import RouteFollower
from coopsim.support.checks import require_positive
from coopsim.types import Ints, Mask

WALKS_M_S = 1.4
"""Speed of people who step out: 5 km/h, as of the child from behind parked cars in Euro NCAP's test of vulnerable road
users."""

STOPS_M_S2, STOPS_S = 5.0, 0.7
"""Braking, and time before it, by which the car could stop for whom it does not see yet: ours, hard but not as hard as
it can; and two frames that confirm a track, and the delay and the build-up of the emergency brake."""

_AHEAD_M, _SIDE_M = np.arange(2.0, 41.0, 2.0), np.array([0.5, 1.0, 1.5, 2.0, 3.0])
_STANDS_M_S = 2.0  # faster vehicles do not hide a place for long
_EYE_M = 2.5  # a track as near to an eye is the body that carries it


@PLANNERS.register("cautious")
@dataclass(kw_only=True, eq=False)
class Cautious(RouteFollower):
    """Follow the route, no faster than what hidden places allow: the rest is `RouteFollower`'s.

    Attributes:
        sees_m: distance up to which the car and other agents see; ours, near what a LiDAR sees of a person.
        least_m_s: speed below which it does not slow for hidden people; ours: it could hardly harm them.
        creeps_m_s: speed with which it feels its way over a junction into which it cannot see; ours.
    """

    occlusion_aware: ClassVar[bool] = True
    sees_m: float = 50.0
    least_m_s: float = 4.0
    creeps_m_s: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(sees_m=self.sees_m, least_m_s=self.least_m_s, creeps_m_s=self.creeps_m_s)
        nowhere = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4)), np.zeros((0, 7))
        hidden(*nowhere, self.sees_m)  # compiled here, as the time for a plan is limited

    def plan(self, car: PlannedCar) -> tuple[float, float]:  # type: ignore[override]  # it steers, too
        if car.occlusions is None:
            return super().plan(car)
        limits = car.route.speed_limit_m_s.copy()
        hides = self._hidden(car, car.occlusions)
        limits[0] = min(limits[0], self._past_people_m_s(car, hides))
        lines = _points_at(car, self._blind_lines_m(car, car.occlusions, hides))
        limits[lines] = np.minimum(limits[lines], self.creeps_m_s)
        return super().plan(replace(car, route=replace(car.route, speed_limit_m_s=limits)))

    def _hidden(self, car: PlannedCar, occlusions: Occlusions) -> Callable[[Floats], Mask]:
        """Return the function that tells of places (P, 2) m whether nobody sees them."""
        eyes = np.concatenate([np.zeros((1, 2)), occlusions.eyes])
        standing = (np.hypot(*car.tracks.velocity.T) < _STANDS_M_S) & ~np.isin(car.tracks.label, ON_FOOT)
        boxes = car.tracks.boxes[standing].array
        carries = (np.hypot(*(boxes[:, None, :2] - eyes).transpose(2, 0, 1)) < _EYE_M).any(axis=1)
        cover = np.concatenate([occlusions.walls, sides(boxes[~carries])])
        return lambda places: hidden(np.ascontiguousarray(places), eyes, cover, boxes, self.sees_m)

    def _past_people_m_s(self, car: PlannedCar, hides: Callable[[Floats], Mask]) -> float:
        """Return the speed, m/s, with which the car could stop for people who may step out, or has passed before."""
        places, ahead_m, aside_m = _beside_path(car)
        out = hides(places)
        stops = np.maximum(_stopping_m_s(ahead_m[out]), self.least_m_s)
        passes = (ahead_m[out] + car.length_m) * WALKS_M_S <= car.speed_m_s * aside_m[out]
        return float(np.where(passes, np.inf, stops).min(initial=np.inf))

    def _blind_lines_m(self, car: PlannedCar, occlusions: Occlusions, hides: Callable[[Floats], Mask]) -> Floats:
        """Return the ways to lines, m, before which the car does not see who comes across, and could not pass before.

        A car that can still stop brakes at ease; one that cannot is over the junction before it knows more.
        """
        entries = occlusions.entries[hides(occlusions.entries[:, :2])]
        limit, way_m, line_m = entries[:, 2:].T
        passes = (line_m + car.length_m) * limit <= way_m * car.speed_m_s
        blind: Floats = line_m[(line_m > 0) & ~passes]
        return blind


def _beside_path(car: PlannedCar) -> tuple[Floats, Floats, Floats]:
    """Return places (P, 2) to both sides of the way ahead, their way from the bumper, and that from the body, m."""
    route = car.route
    at = _points_at(car, _AHEAD_M)
    left = np.stack([-route.tangents[at, 1], route.tangents[at, 0]], axis=1)
    aside_m = car.width_m / 2 + np.concatenate([_SIDE_M, -_SIDE_M - car.width_m])
    places = route.points[at][:, None] + aside_m[:, None] * left[:, None]
    count = len(aside_m)
    return places.reshape(-1, 2), np.repeat(_AHEAD_M, count), np.tile(np.tile(_SIDE_M, 2), len(at))


def _points_at(car: PlannedCar, ahead_m: Floats) -> Ints:
    """Return the points (M,) of the route that the front bumper has at ways (M,) m."""
    at = ((ahead_m + car.length_m / 2) / car.route.spacing_m).astype(np.int64)
    return np.minimum(at, len(car.route.points) - 1)


def _stopping_m_s(ahead_m: Floats) -> Floats:
    """Return speeds (M,) m/s from which the car stops in ways (M,) m."""
    delay = STOPS_M_S2 * STOPS_S
    speeds: Floats = np.sqrt(delay**2 + 2 * STOPS_M_S2 * ahead_m) - delay
    return speeds
