"""The layouts `crossing` and `t_junction`: four or three arms meet between buildings that hide one from another."""

from __future__ import annotations

from coopsim.world.places.layout import Layout, lane_outline
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import Building, corner_buildings, row_of_buildings
from coopsim.world.places.streets import Streets, add_arms, add_turns, corner_units, middle_of
from coopsim.world.places.town_layout import town_layout

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
