"""The layouts `crossing` and `t_junction`: four or three arms meet between buildings that hide one from another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.places.layout import GROUND, LANE_M, Layout, flights_around, lane_outline, rectangle
from coopsim.world.places.road_network import Road, RoadNetwork
from coopsim.world.places.scenery import Building, corner_buildings, lane_lines, row_of_buildings, town_map, town_parts
from coopsim.world.places.streets import (
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_arms,
    add_bend,
    add_turns,
    corner_units,
    crosswalk_of,
    cycleways_of,
    footways_of,
    inbound_first,
    middle_of,
    pavements_of,
    place,
    place_all,
    slots_of,
    stripes_of,
)
from coopsim.world.snapshot import StaticPart

_QUADRANTS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def make_crossing() -> Layout:
    """Build the layout with four arms; it has no parameters and no randomness."""
    return _junction(Streets())


def make_t_junction() -> Layout:
    """Build the layout with three arms: the one that leads along y is missing."""
    return _junction(Streets(arms=(0, 2, 3)))


def _junction(streets: Streets) -> Layout:
    """Return streets that meet, with turns between all of them."""
    network = RoadNetwork()
    add_arms(network, streets)
    movements = add_turns(network, streets)
    surface = [quad for lane in network.lanes.values() for quad in lane_outline(lane)] + middle_of(streets)
    rsus = corner_units(9.5, streets.kerb_m + 5.5)
    return town_layout(streets, network, surface, (movements, ()), (_buildings(streets), ()), rsus)


def _buildings(streets: Streets) -> list[Building]:
    buildings: list[Building] = []
    for k, signs in enumerate(_QUADRANTS):
        if {k, (k + 1) % 4} <= set(streets.arms):
            buildings += corner_buildings(streets.corner_m, signs, k)
    for arm, side in ((1, 1), (3, -1)):
        if arm not in streets.arms:
            buildings += row_of_buildings(streets.corner_m, side)
    return buildings


_RING_M = 20.0  # radius of the ring's middle line
_ENTRY_M = 22.0  # radius of the bends between arms and ring: a bus stays in its lane
_MEDIAN_M = 2.0  # between an arm's lanes: leaving buses swing out
_RING_SPEED_M_S, _ENTRY_SPEED_M_S = 7.0, 6.5
_ISLAND_M, _ISLAND_HEIGHT_M = 14.0, 1.3
_CORNER_M = 24.0  # from both middle lines to the buildings
_UNIT_M = 20.5

# The bends touch the ring from outside: their middles are on a circle around the ring's.
_OFFSET_M = _ENTRY_M + (LANE_M + _MEDIAN_M) / 2
_STOP_M = float(np.sqrt(np.square(_RING_M + _ENTRY_M) - np.square(_OFFSET_M)))


def make_roundabout() -> Layout:
    """Build the layout; it has no parameters and no randomness."""
    streets = Streets(stop_m=_STOP_M, length_m=_STOP_M + 101.0, kerb_m=LANE_M + _MEDIAN_M / 2, median_m=_MEDIAN_M)
    network = RoadNetwork()
    add_arms(network, streets)
    for arm in streets.arms:
        _add_ring(network, arm)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    buildings = [building for k in range(4) for building in corner_buildings(_CORNER_M, signs[k], k)]
    surface = [quad for lane in network.lanes.values() for quad in lane_outline(lane)]
    medians = rectangle((_STOP_M, streets.length_m), (-_MEDIAN_M / 2, _MEDIAN_M / 2))
    surface += [place_all(arm, medians) for arm in streets.arms]
    passing = tuple((f"out{arm}", f"in{arm}") for arm in streets.arms)
    movements = (*((f"stop{arm}", f"in{arm}") for arm in streets.arms), *passing)
    rsus = corner_units(_UNIT_M, _UNIT_M)
    return town_layout(streets, network, surface, (movements, passing), (buildings, (_island(),)), rsus)


def _add_ring(network: RoadNetwork, arm: int) -> None:
    """Add an arm's way in and out, and the ring from its exit to the next arm's, counter-clockwise."""
    quarter, middle, after = arm * np.pi / 2, np.zeros(2), (arm + 1) % 4
    touch_rad = float(exact.arctan2(_OFFSET_M, _STOP_M))
    for road, centre, arc, speed_m_s in (
        (
            ("stop", "in"),
            place(arm, (_STOP_M, _OFFSET_M)),
            (_ENTRY_M, -np.pi / 2, touch_rad - np.pi),
            _ENTRY_SPEED_M_S,
        ),
        (
            ("out", "exit"),
            place(arm, (_STOP_M, -_OFFSET_M)),
            (_ENTRY_M, np.pi - touch_rad, np.pi / 2),
            _RING_SPEED_M_S,
        ),
        (("out", "in"), middle, (_RING_M, -touch_rad, touch_rad), _RING_SPEED_M_S),
    ):
        turned = (arc[0], arc[1] + quarter, arc[2] + quarter)
        add_bend(network, (f"{road[0]}{arm}", f"{road[1]}{arm}"), centre, turned, speed_m_s)
    between = (_RING_M, quarter + touch_rad, quarter + np.pi / 2 - touch_rad)
    add_bend(network, (f"in{arm}", f"out{after}"), middle, between, _RING_SPEED_M_S)


def _island() -> StaticPart:
    """Build a mound in the middle, too high to see people behind it from a car's bumper."""
    mesh = trimesh.creation.cylinder(_ISLAND_M, segment=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, _ISLAND_HEIGHT_M]]))
    return StaticPart("island", exact.settled(mesh.vertices), np.asarray(mesh.faces), GROUND, 0.3)


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
