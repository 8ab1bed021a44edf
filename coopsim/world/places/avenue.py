"""The place of left turns across the path of oncoming traffic: two avenues that cross, with bays for left turns.

As on a crossing, streets meet between buildings. The lanes of an avenue lie a median apart, in which there is a bay
before the junction: vehicles that wait in opposite bays hide oncoming traffic from each other.
"""

from __future__ import annotations

import numpy as np

from coopsim.world.places.crossings import town_layout
from coopsim.world.places.layout import LANE_M, Layout, lane_outline
from coopsim.world.places.road_network import Road, RoadNetwork
from coopsim.world.places.scenery import corner_buildings
from coopsim.world.places.streets import (
    APPROACH_SPEED_M_S,
    Streets,
    add_arms,
    add_bend,
    add_straight,
    add_turns,
    corner_units,
    middle_of,
    place,
)

BAY_M = 50.0
"""Length of a bay."""

_STREETS = Streets(stop_m=20.0, length_m=165.0, kerb_m=2 * LANE_M, median_m=2 * LANE_M)
_TURN_M = _STREETS.stop_m + LANE_M / 2  # radius of a left turn, from a bay's middle line to the lane of the next arm
_SIGNS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
_MAST_M = 13.5


def make_avenue() -> Layout:
    """Build two avenues that cross, with bays for left turns; the layout has no parameters and no randomness."""
    network = RoadNetwork()
    add_arms(network, _STREETS)
    movements = [*add_turns(network, _STREETS, turns=(1, 2))]
    movements += [_add_bay(network, arm) for arm in _STREETS.arms]
    surface = [quad for lane in network.lanes.values() for quad in lane_outline(lane)] + middle_of(_STREETS)
    buildings = [each for k, signs in enumerate(_SIGNS) for each in corner_buildings(_STREETS.corner_m, signs, k)]
    rsus = corner_units(_MAST_M, _MAST_M)
    straight = (("stop0", "exit2"), ("stop2", "exit0"))
    rest = {"movements": tuple(movements), "priority": straight}
    return town_layout(_STREETS, network, surface, (buildings, ()), rsus, (), **rest)


def _add_bay(network: RoadNetwork, arm: int) -> Road:
    """Add an arm's bay and the left turn that begins at its end; return the turn."""
    line, half = _TURN_M - _STREETS.half_m, LANE_M / 2
    ends = place(arm, (line + BAY_M, half)), place(arm, (line, half))
    add_straight(network, (f"bay{arm}", f"wait{arm}"), ends, APPROACH_SPEED_M_S)
    turn, first = (f"wait{arm}", f"exit{(arm + 3) % 4}"), np.pi / 2 * (1 + arm)
    add_bend(network, turn, place(arm, (line, half - _TURN_M)), (_TURN_M, first, first + np.pi / 2), APPROACH_SPEED_M_S)
    return turn
