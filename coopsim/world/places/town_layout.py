"""Common surroundings of crossings and roundabouts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.places.layout import Layout, flights_around
from coopsim.world.places.markings import lane_lines
from coopsim.world.places.road_network import Road, RoadNetwork
from coopsim.world.places.scenery import Building, town_map, town_parts
from coopsim.world.places.streets import (
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    crosswalk_of,
    inbound_first,
    pavements_of,
    slots_of,
    stripes_of,
)
from coopsim.world.places.walks import cycleways_of, footways_of
from coopsim.world.snapshot import StaticPart


def town_layout(
    streets: Streets,
    network: RoadNetwork,
    surface: Sequence[Floats],
    rights: tuple[tuple[Road, ...], tuple[Road, ...]],
    around: tuple[Sequence[Building], Sequence[StaticPart]],
    rsus: tuple[SE3, ...],
) -> Layout:
    """Return a layout of streets that meet.

    Args:
        streets: the arms.
        network: all lanes.
        surface: polygons (K, 2) m of the roads.
        rights: movements, and those of them that have priority.
        around: buildings and other parts.
        rsus: places for roadside units.
    """
    slots, (movements, priority), (buildings, parts) = slots_of(streets), rights, around
    crosswalks = [crosswalk_of(streets, arm) for arm in streets.arms]
    road_map = town_map(surface, crosswalks, pavements_of(streets), buildings, lane_lines(network, movements))
    return Layout(
        network=network,
        slots=slots,
        connected_order=inbound_first(slots),
        footways=footways_of(streets),
        rsus=rsus,
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(0.0, SPEED_M_S / 2, SPEED_M_S),
        static=(*town_parts(road_map, stripes_of(streets), buildings, rsus, RSU_HEIGHT_M), *parts),
        road_map=road_map,
        movements=movements,
        priority=priority,
        cycleways=cycleways_of(streets),
        flights=flights_around(np.zeros(2)),
    )
