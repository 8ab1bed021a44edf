"""Drivers that leave their lane late, before an obstacle ahead: they uncover what they have hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.world.places.road_network import LaneIndex
from coopsim.world.script import VehicleRole
from coopsim.world.traffic.fleet import TOWN, Fleet
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.rules import STANDING_M_S

LEAVING_GAIN_1_S = 1.0
"""Lateral gain of a late lane change: a car is 2.5 m aside after 1.2 s. Naturalistic changes of lane take 2 to 8 s
(Toledo and Zohar, Transportation Research Record 1999, 2007); these are the briskest."""


class CutOut:
    """Vehicles of a script that leave their lane at `trigger_m` before an obstacle.

    Until then they keep their speed; from then on they drive as others do in town.

    Args:
        roles: the vehicles of the script, by row.
        network: the roads.
    """

    def __init__(self, roles: Sequence[VehicleRole], network: NumberedNetwork) -> None:
        self._network = network
        self._waiting = {row: role for row, role in enumerate(roles) if role.manner == "leaves lane"}

    def act(self, fleet: Fleet) -> None:
        """Send vehicles that have come close to an obstacle to a neighbouring lane."""
        for row, role in tuple(self._waiting.items()):
            if self._gap_m(fleet, row) <= (role.trigger_m or 0.0):
                vehicle = fleet.rows[row]
                vehicle["driver"], vehicle["lateral_gain"] = TOWN, LEAVING_GAIN_1_S
                vehicle["target_lane"] = self._network.lane_number[self._beside(role.lane)]
                del self._waiting[row]

    def _beside(self, lane: LaneIndex) -> LaneIndex:
        """Return the lane to the left, or to the right of the leftmost."""
        start, end, number = lane
        return (start, end, number - 1 if number else 1)

    def _gap_m(self, fleet: Fleet, row: int) -> float:
        """Return the gap between bumpers to the next standing vehicle in the lane, m."""
        rows = fleet.rows
        lane = self._network.source.get_lane(self._network.lane_index[rows["target_lane"][row]])
        at = np.array([lane.local_coordinates(place) for place in fleet.position])
        ahead_m = at[:, 0] - at[row, 0]
        stands = (np.abs(at[:, 1]) < lane.width / 2) & (rows["speed"] < STANDING_M_S) & (ahead_m > 0)
        gaps = ahead_m - (rows["length"] + rows["length"][row]) / 2
        return float(np.where(stands, gaps, np.inf).min())
