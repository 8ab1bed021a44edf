"""The layout `roundabout`: four arms on a ring of one lane; vehicles on the ring have right of way."""

from __future__ import annotations

import numpy as np
import trimesh

from coopsim.geometry import exact
from coopsim.world.places.layout import GROUND, LANE_M, Layout, lane_outline, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import corner_buildings
from coopsim.world.places.streets import Streets, add_arms, add_bend, corner_units, place, place_all
from coopsim.world.places.town_layout import town_layout
from coopsim.world.snapshot import StaticPart

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
