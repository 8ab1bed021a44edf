"""Knowledge of what may hide others from driven cars: walls of the map, and places of the senders of messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import Occlusions
from coopsim.types import Observation
from coopsim.world.snapshot import RoadMap

NEAR_M = 60.0
"""Walls farther from a car than this are left out."""


class OcclusionMap:
    """Map of what may hide others, for all cars in an episode.

    Args:
        road_map: has the buildings and walls of the place.
        entries: places (A, 5) of `Occlusions.entries` by the car's name, in its base frame.
    """

    def __init__(self, road_map: RoadMap, entries: Callable[[str], Floats]) -> None:
        outlines = [np.asarray(each) for each in (*road_map.buildings, *road_map.walls)]
        walls = [np.concatenate([each, np.roll(each, -1, axis=0)], axis=1) for each in outlines]
        self._walls, self._entries = np.concatenate([np.zeros((0, 4)), *walls]), entries
        self._eyes: dict[str, Floats] = {}

    def hear(self, received: Mapping[str, Observation]) -> None:
        """Take note of where the senders of messages are, by what these say."""
        for name, observation in received.items():
            places = [message.pose.xyz_yaw[:2] for message in observation.inbox]
            self._eyes[name] = np.array(places).reshape(-1, 2)

    def of(self, name: str, xyz_yaw: Floats) -> Occlusions:
        """Return what is around a car, placed in its map by where it takes itself to be, (4,) m and rad."""
        x, y, _, yaw = xyz_yaw.tolist()
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        walls = (self._walls.reshape(-1, 2, 2) - [x, y]) @ turn
        near = np.abs(walls).max(axis=2).min(axis=1) < NEAR_M
        eyes = (self._eyes.get(name, np.zeros((0, 2))) - [x, y]) @ turn
        return Occlusions(walls[near].reshape(-1, 4), eyes, self._entries(name))
