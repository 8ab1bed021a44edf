"""The layouts `crossing` and `t_junction`: four or three arms meet between buildings that hide one from another."""

from __future__ import annotations

import numpy as np
from highway_env.road.road import RoadNetwork

from coopsim.geometry.se3 import Floats
from coopsim.world.layout import LANE_M, Layout, flights_around, lane_outline, rectangle
from coopsim.world.scenery import Building, corner_buildings, row_of_buildings, town_map, town_parts
from coopsim.world.streets import (
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_arms,
    add_turns,
    corner_units,
    crosswalk_of,
    inbound_first,
    pavements_of,
    place_all,
    slots_of,
    stripes_of,
)
from coopsim.world.walks import cycleways_of, footways_of

_QUADRANTS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def make_crossing() -> Layout:
    """Four arms. Build the layout; it has no parameters and no randomness."""
    return _junction(Streets())


def make_t_junction() -> Layout:
    """Three arms: the one that leads along y is missing."""
    return _junction(Streets(arms=(0, 2, 3)))


def _junction(streets: Streets) -> Layout:
    """Streets that meet, with turns between all of them by the rule of `coopsim.world.junction`."""
    network = RoadNetwork()
    add_arms(network, streets)
    movements = add_turns(network, streets)
    slots, rsus, buildings = slots_of(streets), corner_units(9.5, streets.kerb_m + 5.5), _buildings(streets)
    lanes = [quad for lane in network.lanes_list() for quad in lane_outline(lane)] + _middle(streets)
    crosswalks = [crosswalk_of(streets, arm) for arm in streets.arms]
    road_map = town_map(lanes, crosswalks, pavements_of(streets), buildings)
    return Layout(
        network,
        slots,
        inbound_first(slots),
        footways_of(streets),
        rsus,
        RSU_HEIGHT_M,
        (0.0, SPEED_M_S / 2, SPEED_M_S),
        town_parts(road_map, stripes_of(streets), buildings, rsus, RSU_HEIGHT_M),
        road_map,
        movements=movements,
        cycleways=cycleways_of(streets),
        flights=flights_around(np.zeros(2)),
    )


def _middle(streets: Streets) -> list[Floats]:
    """The surface between the stop lines."""
    return [place_all(arm, rectangle((0.0, streets.stop_m), (-LANE_M, LANE_M))) for arm in streets.arms]


def _buildings(streets: Streets) -> list[Building]:
    buildings: list[Building] = []
    for k, signs in enumerate(_QUADRANTS):
        if {k, (k + 1) % 4} <= set(streets.arms):
            buildings += corner_buildings(streets.corner_m, signs, k)
    for arm, side in ((1, 1), (3, -1)):
        if arm not in streets.arms:
            buildings += row_of_buildings(streets.corner_m, side)
    return buildings
