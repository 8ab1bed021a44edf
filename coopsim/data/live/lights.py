"""Lights of SUMO as those of a place: which light of a program each stop line of the place has."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.data.maps.place.lights import LETTERS_OF_SUMO
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import Layout
from coopsim.world.places.signals import GIVE_WAY

_NEAR_M = 8.0  # a movement of the place may begin a bit before or behind the lane's end


class SumoLights:
    """States of the stop lines of a place.

    Args:
        sumo: libsumo.
        layout: the place.
        middle: (2,) m, its origin in the network's plane.
    """

    def __init__(self, sumo: Any, layout: Layout, middle: Floats) -> None:
        self._sumo = sumo
        roads = [road for signal in layout.signals for road in signal.roads]
        links = _links(sumo) if roads else {}
        there = np.array(list(links.values())).reshape(-1, 4) - np.tile(middle, 2)
        self._lights: list[tuple[str, int] | None] = []
        for road in roads:
            lane = layout.network.get_lane((*road, 0))
            ends = np.concatenate([lane.position(0.0, 0.0), lane.position(lane.length, 0.0)])
            apart = exact.norm(there[:, :2] - ends[:2]) + exact.norm(there[:, 2:] - ends[2:])
            near = len(apart) and float(apart.min()) < _NEAR_M
            self._lights.append(list(links)[int(apart.argmin())] if near else None)
        self._programs = {light[0] for light in self._lights if light is not None}

    def letters(self) -> str:
        """Return the letters of `RoadMap.lights` now; a line without a light in SUMO has one that is off."""
        state = {name: self._sumo.trafficlight.getRedYellowGreenState(name) for name in self._programs}
        shown = [GIVE_WAY if light is None else state[light[0]][light[1]] for light in self._lights]
        return "".join(shown).translate(LETTERS_OF_SUMO)


def _links(sumo: Any) -> dict[tuple[str, int], Floats]:
    """Return the ends (4,) m of the ways that have lights, by program and number of the light."""
    found = {}
    for name in sumo.trafficlight.getIDList():
        for number, links in enumerate(sumo.trafficlight.getControlledLinks(name)):
            for start, end, _ in links[:1]:
                found[name, number] = np.array([*sumo.lane.getShape(start)[-1], *sumo.lane.getShape(end)[0]])
    return found
