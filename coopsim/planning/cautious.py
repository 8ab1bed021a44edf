"""A planner that also slows before what nobody sees: from behind each corner somebody might come.

It follows "Occlusion-Aware Risk Assessment for Autonomous Driving in Urban Environments" (Yu, Vasudevan and
Johnson-Roberson, IEEE Robotics and Automation Letters 4, 2019) in that it thinks of people and vehicles in all hidden
places, and the set-based view of Koschi and Althoff ("Set-Based Prediction of Traffic Participants Considering
Occlusions and Traffic Rules", IEEE Transactions on Intelligent Vehicles 6, 2021) in that it drives so that it can stop
for each of them, or has passed before. A place is hidden where the line to the car, and to each agent whose message has
just arrived, is cut by a wall of the map or by a track that stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import PLANNERS, PlannedCar, Sight
from coopsim.planning.hidden import hidden, sides
from coopsim.planning.idm_aeb import ON_FOOT
from coopsim.planning.route_follower import RouteFollower
from coopsim.support.checks import require_positive

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

    looks: ClassVar[bool] = True
    sees_m: float = 50.0
    least_m_s: float = 4.0
    creeps_m_s: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(sees_m=self.sees_m, least_m_s=self.least_m_s, creeps_m_s=self.creeps_m_s)
        nowhere = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4)), np.zeros((0, 7))
        hidden(*nowhere, self.sees_m)  # compiled here, as the time for a plan is limited

    def plan(self, car: PlannedCar) -> tuple[float, float]:
        if car.sight is None:
            return super().plan(car)
        most = self._most_m_s(car, car.sight)
        limits = np.minimum(car.route.speed_limit_m_s, most)
        return super().plan(replace(car, route=replace(car.route, speed_limit_m_s=limits)))

    def _most_m_s(self, car: PlannedCar, sight: Sight) -> float:
        """Return the speed, m/s, with which the car could stop for all who may hide, or would have passed them."""
        eyes = np.concatenate([np.zeros((1, 2)), sight.eyes])
        standing = (np.hypot(*car.tracks.velocity.T) < _STANDS_M_S) & ~np.isin(car.tracks.label, ON_FOOT)
        boxes = car.tracks.boxes[standing].array
        carries = (np.hypot(*(boxes[:, None, :2] - eyes).transpose(2, 0, 1)) < _EYE_M).any(axis=1)
        cover = np.concatenate([sight.walls, sides(boxes[~carries])])
        places, along_m, aside_m = _beside_path(car)
        out = hidden(places, eyes, cover, boxes, self.sees_m)
        people = _allowed_m_s(car, along_m[out], aside_m[out] / WALKS_M_S, self.least_m_s)
        entries = sight.entries[sight.entries[:, 4] > 0]
        out = hidden(np.ascontiguousarray(entries[:, :2]), eyes, cover, boxes, self.sees_m)
        x, y, limit, way_m, line_m = entries[out].T
        return min(people, _allowed_m_s(car, line_m, way_m / limit, self.creeps_m_s))


def _beside_path(car: PlannedCar) -> tuple[Floats, Floats, Floats]:
    """Return places (P, 2) to both sides of the way ahead, their way from the bumper, and that from the body, m."""
    route, half_m = car.route, car.length_m / 2
    at = np.minimum(((_AHEAD_M + half_m) / route.spacing_m).astype(int), len(route.points) - 1)
    left = np.stack([-route.tangents[at, 1], route.tangents[at, 0]], axis=1)
    aside_m = car.width_m / 2 + np.concatenate([_SIDE_M, -_SIDE_M - car.width_m])
    places = route.points[at][:, None] + aside_m[:, None] * left[:, None]
    count = len(aside_m)
    return places.reshape(-1, 2), np.repeat(_AHEAD_M, count), np.tile(np.tile(_SIDE_M, 2), len(at))


def _allowed_m_s(car: PlannedCar, ahead_m: Floats, comes_s: Floats, least_m_s: float) -> float:
    """Return the speed, m/s, from which the car stops in ways (M,) m, or with which it passes before times (M,) s."""
    delay = STOPS_M_S2 * STOPS_S
    stops = np.sqrt(delay**2 + 2 * STOPS_M_S2 * np.maximum(ahead_m, 0.0)) - delay
    passes = (ahead_m + car.length_m) / np.maximum(comes_s, 1e-3) <= car.speed_m_s
    return float(np.where(passes, np.inf, np.maximum(stops, least_m_s)).min(initial=np.inf))
