"""The drivable area of a place."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.geometry.surface import Surface
from coopsim.world.snapshot import RoadMap


class DrivableArea:
    """The drivable area of a place: lanes, parking and crosswalks; cars on rails never leave it."""

    def __init__(self, road_map: RoadMap) -> None:
        self._road = Surface([*road_map.lanes, *road_map.parking, *road_map.crosswalks])
        self._pavements = Surface(road_map.pavements)

    def left(self, pose: Floats, length_m: float, width_m: float) -> tuple[bool, bool]:
        """Return whether the middle of a body is off the road, and whether that or a corner has left the area.

        Args:
            pose: (3,) x, y, m, and heading, rad, in the world frame.
            length_m: length of the body.
            width_m: width of the body.
        """
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        ahead, left = np.array([cos, sin]) * length_m / 2, np.array([-sin, cos]) * width_m / 2
        corners = pose[:2] + np.stack([ahead + left, ahead - left, -ahead - left, left - ahead])
        off_road = self.is_off_road(pose[:2])
        return off_road, off_road or self.is_pavement(corners)

    def is_off_road(self, place: Floats) -> bool:
        """Return whether a place (2,) m is on no road."""
        return not bool(self._road.covers(place[None])[0])

    def is_pavement(self, places: Floats) -> bool:
        """Return whether one of places (K, 2) m is on a pavement."""
        return bool(self._pavements.covers(places).any())
