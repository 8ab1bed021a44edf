"""Outcomes of drives, in the words of MetaDrive and highway-env.

| key of infos | whose word | meaning |
|---|---|---|
| `crash`, `crashed` | MetaDrive, highway-env | the car has touched something |
| `crash_vehicle`, `crash_human`, `crash_building` | MetaDrive | what it was |
| `crash_object` | MetaDrive | it was a tree, a pole or furniture |
| `crash_sidewalk` | MetaDrive | a corner of the car is on a pavement: it has mounted a kerb; ends nothing |
| `out_of_road` | MetaDrive | the car's middle has left the road's surface |
| `out_of_route` | MetaDrive | it is farther than 30 m from its route |
| `arrive_dest` | MetaDrive | it has reached the goal |
| `max_step` | MetaDrive | its time is over |
| `route_completion` | MetaDrive | share of the route that is behind it, in [0, 1] |
| `speed` | highway-env | m/s |
| `red_light` | ours | its front has crossed a line at red in this step; ends nothing |
| `wrong_way` | ours | it is on lanes that all lead the other way; ends nothing |
| `is_success` | Stable-Baselines3 | at the end: whether it has arrived |
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.types.driving import CarState
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drivable_area import DrivableArea
from coopsim.world.snapshot import RoadMap, RoadUsers

_TOUCHES_M = 0.5  # bodies that crashed have been pushed apart
_FAR_M = 10.0  # farther bodies cannot touch
_KINDS = ("vehicle", "human", "building", "object")
_ON_FOOT = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD, ObjectClass.BICYCLE, ObjectClass.SCOOTER)


@dataclass(frozen=True, slots=True)
class Outcome:
    """State of a drive after a step.

    Attributes:
        infos: see the module.
        terminated: it is over: the car crashed, left the road or its route, or arrived.
        arrives: it has arrived.
        leaves: it has left the road or its route.
    """

    infos: dict[str, Any]
    terminated: bool
    arrives: bool
    leaves: bool


class Judge:
    """Judge of the drives in one place."""

    def __init__(self, road_map: RoadMap) -> None:
        self._area = DrivableArea(road_map)

    def outcome(self, was: CarState, car: CarState, me: int, users: RoadUsers, hit: str, *, timed_out: bool) -> Outcome:
        """Return what has become of a car.

        Args:
            was: the car as it knew itself before the step.
            car: the car as it knows itself.
            me: its row among the road users.
            users: everybody, in the world frame.
            hit: the thing beside the road that it has crashed into, see `World.hit`.
            timed_out: whether its time is over.
        """
        corners = _corners_of(users, me)
        arrives = not car.crashed and car.route.arrived
        left, strays = self._area.is_off_road(users.position[me]), car.route.strayed
        if car.crashed:
            hit = hit or _touched(corners, me, users)
        infos: dict[str, Any] = {f"crash_{kind}": hit == kind for kind in _KINDS}
        infos |= {
            "crash": car.crashed,
            "crashed": car.crashed,
            "crash_sidewalk": self._area.is_pavement(corners),
            "out_of_road": left,
            "out_of_route": strays,
            "arrive_dest": arrives,
            "max_step": timed_out,
            "route_completion": 1.0 if arrives else car.route.completion,
            "speed": car.speed_m_s,
            "red_light": car.red_lights > was.red_lights,
            "wrong_way": car.wrong_way,
        }
        terminated = bool(car.crashed or left or strays or arrives)
        if terminated or timed_out:
            infos["is_success"] = arrives
        return Outcome(infos, terminated, arrives, bool(left or strays))


def _corners_of(users: RoadUsers, row: int) -> Floats:
    """Return the corners (4, 2) of a body from above, m."""
    (x, y), (length, width), yaw = users.position[row].tolist(), users.size[row, :2].tolist(), float(users.yaw[row])
    ahead_x, ahead_y = length / 2 * math.cos(yaw), length / 2 * math.sin(yaw)
    left_x, left_y = -width / 2 * math.sin(yaw), width / 2 * math.cos(yaw)
    return np.array(
        [
            [x + ahead_x + left_x, y + ahead_y + left_y],
            [x - ahead_x + left_x, y - ahead_y + left_y],
            [x - ahead_x - left_x, y - ahead_y - left_y],
            [x + ahead_x - left_x, y + ahead_y - left_y],
        ]
    )


def _touched(corners: Floats, me: int, users: RoadUsers) -> str:
    """Return what a crashed car has touched: "human", or else "vehicle"."""
    reach = np.hypot(*(users.position - corners.mean(axis=0)).T) - np.hypot(*users.size.T[:2]) / 2
    reach[me] = np.inf
    for row in np.flatnonzero(reach < _FAR_M).tolist():
        ground = TakenGround()
        ground.take(_corners_of(users, row))
        if users.label[row] in _ON_FOOT and not ground.is_free(corners, _TOUCHES_M):
            return "human"
    return "vehicle"
