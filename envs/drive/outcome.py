"""Outcomes of drives, in the words of MetaDrive and highway-env.

| key of infos | whose word | meaning |
|---|---|---|
| `crash`, `crashed` | MetaDrive, highway-env | the car has touched something |
| `crash_vehicle`, `crash_human`, `crash_building` | MetaDrive | what it was |
| `crash_sidewalk` | MetaDrive | a corner of the car is on a pavement: it has mounted a kerb; ends nothing |
| `out_of_road` | MetaDrive | the car's middle has left the road's surface |
| `out_of_route` | MetaDrive | it is farther than 30 m from its route |
| `arrive_dest` | MetaDrive | it has reached the goal |
| `max_step` | MetaDrive | its time is over |
| `route_completion` | MetaDrive | share of the route that is behind it, in [0, 1] |
| `speed` | highway-env | m/s |
| `wrong_way` | ours | it is on lanes that all lead the other way; ends nothing |
| `red_lights` | ours | number of red lights that it has run so far; ends nothing |
| `is_success` | Stable-Baselines3 | at the end: whether it has arrived |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.envs.drive.surface import Surface
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.types.driving import CarState
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import Actors, RoadMap

_TOUCHES_M = 0.5  # bodies that crashed have been pushed apart
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
        self._road = Surface([*road_map.lanes, *road_map.parking, *road_map.crosswalks])
        self._pavements = Surface(road_map.pavements)

    def outcome(self, car: CarState, me: int, actors: Actors, *, timed_out: bool) -> Outcome:
        """Return what has become of the car with the id `me` among the actors, all in the world frame."""
        (row,) = np.flatnonzero(actors.id == me)
        corners = _corners(actors.boxes, int(row))
        middle = actors.boxes.center[row : row + 1, :2]
        arrives = not car.crashed and car.route.arrived
        left, strays = not self._road.covers(middle)[0], car.route.strayed
        hit = _touched(corners, me, actors) if car.crashed else ""
        infos: dict[str, Any] = {f"crash_{kind}": hit == kind for kind in ("vehicle", "human", "building")}
        infos |= {
            "crash": car.crashed,
            "crashed": car.crashed,
            "crash_sidewalk": bool(self._pavements.covers(corners).any()),
            "out_of_road": bool(left),
            "out_of_route": strays,
            "arrive_dest": arrives,
            "max_step": timed_out,
            "route_completion": 1.0 if arrives else car.route.completion,
            "speed": car.speed_m_s,
            "wrong_way": car.wrong_way,
            "red_lights": car.red_lights,
        }
        terminated = bool(car.crashed or left or strays or arrives)
        if terminated or timed_out:
            infos["is_success"] = arrives
        return Outcome(infos, terminated, arrives, bool(left or strays))


def _corners(boxes: Boxes3D, row: int) -> Floats:
    """Return the corners (4, 2) of a box from above, m."""
    (length, width), yaw = boxes.size[row, :2] / 2, boxes.yaw[row]
    ahead = length * np.array([np.cos(yaw), np.sin(yaw)])
    left = width * np.array([-np.sin(yaw), np.cos(yaw)])
    middle: Floats = boxes.center[row, :2]
    return np.stack([middle + ahead + left, middle - ahead + left, middle - ahead - left, middle + ahead - left])


def _touched(corners: Floats, me: int, actors: Actors) -> str:
    """Return what a crashed car has touched: "human", "vehicle", or else "building"."""
    reach = np.hypot(*(actors.boxes.center[:, :2] - corners.mean(axis=0)).T) - np.hypot(*actors.boxes.size.T[:2]) / 2
    near = np.flatnonzero((reach < 10.0) & (actors.id != me))
    touched = []
    for row in near.tolist():
        ground = TakenGround()
        ground.take(_corners(actors.boxes, row))
        if not ground.is_free(corners, _TOUCHES_M):
            touched.append(actors.label[row])
    if not touched:
        return "building"
    return "human" if any(label in _ON_FOOT for label in touched) else "vehicle"
