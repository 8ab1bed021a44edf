"""The layouts `crossing` and `t_junction`: four or three arms meet between buildings that hide one from another."""

from __future__ import annotations

import numpy as np
from highway_env.road.road import RoadNetwork

from coopsim.geometry.se3 import Floats
from coopsim.world.layout import LANE_M, Layout, flights_around, lane_outline, rectangle
from coopsim.world.scenery import Building, corner_buildings, row_of_buildings, town_map, town_parts
from coopsim.world.streets import (
    APPROACH_SPEED_M_S,
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_arms,
    add_bend,
    add_straight,
    corner_units,
    crosswalk_of,
    inbound_first,
    pavements_of,
    place,
    place_all,
    slots_of,
    stripes_of,
)
from coopsim.world.walks import cycleways_of, footways_of

_TURN_SPEED_M_S = 6.5
_QUADRANTS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def make_crossing() -> Layout:
    """Four arms. Build the layout; it has no parameters and no randomness."""
    return junction_layout(Streets())


def make_t_junction() -> Layout:
    """Three arms: the one that leads along y is missing."""
    return junction_layout(Streets(arms=(0, 2, 3)))


def junction_layout(streets: Streets) -> Layout:
    """Streets that meet, with turns between all of them by the rule of `coopsim.world.junction`."""
    network = RoadNetwork()
    add_arms(network, streets)
    add_turns(network, streets)
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
        movements=tuple(
            (f"stop{arm}", f"exit{other}") for arm in streets.arms for other in streets.arms if other != arm
        ),
        cycleways=cycleways_of(streets),
        flights=flights_around(np.zeros(2)),
    )


def add_turns(network: RoadNetwork, streets: Streets) -> None:
    """From every arm's stop line to the other arms' exits."""
    stop, half = streets.stop_m, LANE_M / 2
    for arm in streets.arms:
        for turn in (1, 2, 3):
            other = (arm + turn) % 4
            if other not in streets.arms:
                continue
            road = f"stop{arm}", f"exit{other}"
            if turn == 2:
                ends = place(arm, (stop, half)), place(arm, (-stop, half))
                add_straight(network, road, ends, APPROACH_SPEED_M_S)
                continue
            side = 1 if turn == 1 else -1  # the next arm is to the right of those who come in
            start = -side * np.pi / 2 + arm * np.pi / 2
            arc = (stop - half * side, start, start - side * np.pi / 2)
            add_bend(network, road, place(arm, (stop, side * stop)), arc, _TURN_SPEED_M_S)


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
