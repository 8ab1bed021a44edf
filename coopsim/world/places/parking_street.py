"""The layouts `parking_street` and `occluded_crossing`: one straight street, with vehicles parked at its kerbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import LANE_M, Bay, Footways, Layout, flights_around, lane_outline, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import lane_lines, row_of_buildings, town_map, town_parts
from coopsim.world.places.streets import (
    APPROACH_SPEED_M_S,
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_arms,
    add_straight,
    corner_units,
    crosswalk_of,
    footways_of,
    inbound_first,
    pavements_of,
    place,
    slots_of,
    stripes_of,
)

_BAY_M = 2.7  # width of the strip between lane and pavement
_BAY_LENGTH_M = 6.4
_FREE_M = 2.5  # kept free on both sides of a crosswalk's middle
_ROW_M = 88.0  # from the middle to where bays end
_TRUCK_M = 9.6  # of the longest truck
_WALK_OUT_M = 30.0  # from the middle to where people turn back, at the occluded crossing


def make_parking_street() -> Layout:
    """Build a street with parked cars on both sides, over the whole length; it has no parameters and no randomness."""
    streets = _streets()
    return _street_layout(streets, _bays(streets), footways_of(streets))


def make_occluded_crossing() -> Layout:
    """Build a street with one crosswalk, and a truck that hides people who step onto it from eastbound drivers.

    People walk to and fro near the crosswalk and over it. Westbound drivers see them early.
    """
    streets = _streets()
    aside = LANE_M + _BAY_M / 2
    before = -streets.crosswalk_m - _FREE_M - _TRUCK_M / 2
    truck = Bay(before, -aside, 0.0, ObjectClass.TRUCK)
    free = before - _TRUCK_M / 2, -before
    others = [bay for bay in _bays(streets) if not free[0] - _BAY_LENGTH_M / 2 < bay.x_m < free[1]]
    layout = _street_layout(streets, (truck, *others), _one_crossing(streets), crosswalks=(2,))
    return replace(layout, connected_order=_meeting_first(layout), cars_first=2)


def _meeting_first(layout: Layout) -> tuple[int, ...]:
    """Rank slots: a car that comes up behind the truck, one that comes towards it, both from far; then the rest."""
    far = [("far2", "near2", 0), ("far0", "near0", 0)]
    first = [max((slot.along_m, k) for k, slot in enumerate(layout.slots) if slot.lane == lane)[1] for lane in far]
    return (*first, *(k for k in layout.connected_order if k not in first))


def _streets() -> Streets:
    return Streets(arms=(0, 2), kerb_m=LANE_M + _BAY_M)


def _street_layout(
    streets: Streets, bays: tuple[Bay, ...], footways: Footways, crosswalks: tuple[int, ...] = (0, 2)
) -> Layout:
    network = RoadNetwork()
    add_arms(network, streets)
    stop, half = streets.stop_m, LANE_M / 2
    for arm in streets.arms:
        ends = place(arm, (stop, half)), place(arm, (-stop, half))
        add_straight(network, (f"stop{arm}", f"exit{(arm + 2) % 4}"), ends, APPROACH_SPEED_M_S)
    slots, rsus = slots_of(streets), corner_units(9.5, streets.kerb_m + 5.5)
    buildings = row_of_buildings(streets.corner_m, 1) + row_of_buildings(streets.corner_m, -1)
    strips = [rectangle((-_ROW_M, _ROW_M), span) for span in ((-streets.kerb_m, -LANE_M), (LANE_M, streets.kerb_m))]
    lanes = [quad for lane in network.lanes.values() for quad in lane_outline(lane)] + strips
    stripes = [crosswalk_of(streets, arm) for arm in crosswalks]
    road_map = town_map(lanes, stripes, pavements_of(streets), buildings, lane_lines(network))
    return Layout(
        network=network,
        slots=slots,
        connected_order=inbound_first(slots),
        footways=footways,
        rsus=rsus,
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(0.0, SPEED_M_S / 2, SPEED_M_S),
        static=town_parts(road_map, stripes_of(streets, crosswalks), buildings, rsus, RSU_HEIGHT_M),
        road_map=road_map,
        bays=bays,
        flights=flights_around(np.zeros(2)),
    )


def _bays(streets: Streets) -> tuple[Bay, ...]:
    """Return bays between the crosswalks and outwards of them, on both sides, in the direction of traffic."""
    inner = streets.crosswalk_m - _FREE_M, streets.crosswalk_m + _FREE_M
    spans = ((-_ROW_M, -inner[1]), (-inner[0], inner[0]), (inner[1], _ROW_M))
    aside = LANE_M + _BAY_M / 2
    return tuple(
        Bay(low + (k + 0.5) * (high - low) / count, side * aside, 0.0 if side < 0 else np.pi)
        for side in (-1, 1)
        for low, high in spans
        for count in (int((high - low) // _BAY_LENGTH_M),)
        for k in range(count)
    )


def _one_crossing(streets: Streets) -> Footways:
    """Return ways with the nodes west, crosswalk and east on the left (y > 0), then on the right."""
    places = (-_WALK_OUT_M, -streets.crosswalk_m, _WALK_OUT_M / 2)
    nodes = [(x, side * streets.walk_m) for side in (1, -1) for x in places]
    neighbours = np.array([[1, -1, -1], [0, 2, 4], [1, -1, -1], [4, -1, -1], [3, 5, 1], [4, -1, -1]])
    crossing = np.zeros((6, 6), dtype=bool)
    crossing[1, 4] = crossing[4, 1] = True
    return Footways(np.array(nodes), neighbours, crossing)
