"""The layouts `crossing`, `t_junction` and `roundabout`, and `parking_street` and `occluded_crossing`.

Streets meet between buildings that hide one from another; on the ring of the roundabout, of one lane, vehicles have
right of way. A single street has vehicles parked at its kerbs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import GROUND, LANE_M, Bay, Footways, Layout, flights_around, lane_outline, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import Building, corner_buildings, lane_lines, row_of_buildings, town_map, town_parts
from coopsim.world.places.shapes import cylinder
from coopsim.world.places.streets import (
    APPROACH_SPEED_M_S,
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_arms,
    add_bend,
    add_straight,
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
    """Build a crossing of four arms between buildings; the layout has no parameters and no randomness."""
    return _junction(Streets())


def make_t_junction() -> Layout:
    """Build a junction of three arms between buildings: of the crossing, one that leads along y is missing."""
    return _junction(Streets(arms=(0, 2, 3)))


def _junction(streets: Streets) -> Layout:
    """Return streets that meet, with turns between all of them."""
    network = RoadNetwork()
    add_arms(network, streets)
    movements = add_turns(network, streets)
    surface = [quad for lane in network.lanes.values() for quad in lane_outline(lane)] + middle_of(streets)
    rsus = corner_units(9.5, streets.kerb_m + 5.5)
    return town_layout(streets, network, surface, (_buildings(streets), ()), rsus, movements=movements)


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

_BAY_M = 2.7  # width of the strip between lane and pavement
_BAY_LENGTH_M = 6.4
_FREE_M = 2.5  # kept free on both sides of a crosswalk's middle
_ROW_M = 88.0  # from the middle to where bays end
_TRUCK_M = 9.6  # of the longest truck
_WALK_OUT_M = 30.0  # from the middle to where people turn back, at the occluded crossing

# The bends touch the ring from outside: their middles are on a circle around the ring's.
_OFFSET_M = _ENTRY_M + (LANE_M + _MEDIAN_M) / 2
_STOP_M = float(np.sqrt(np.square(_RING_M + _ENTRY_M) - np.square(_OFFSET_M)))


def make_roundabout() -> Layout:
    """Build a roundabout with four arms; the layout has no parameters and no randomness."""
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
    around = buildings, (_island(),)
    return town_layout(streets, network, surface, around, rsus, movements=movements, priority=passing)


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
    return StaticPart("island", *cylinder(_ISLAND_M, _ISLAND_HEIGHT_M), GROUND, 0.3)


def town_layout(
    streets: Streets,
    network: RoadNetwork,
    surface: Sequence[Floats],
    around: tuple[Sequence[Building], Sequence[StaticPart]],
    rsus: tuple[SE3, ...],
    crosswalks: tuple[int, ...] | None = None,
    **rest: Any,
) -> Layout:
    """Return a layout of streets, with crosswalks over some arms (None: all); `rest` has further fields of `Layout`.

    `surface` has polygons (K, 2) m of the roads, `around` buildings and other parts.
    """
    slots, (buildings, parts), movements = slots_of(streets), around, rest.get("movements", ())
    arms = streets.arms if crosswalks is None else crosswalks
    outlines, lines = [crosswalk_of(streets, arm) for arm in arms], lane_lines(network, movements)
    road_map = town_map(surface, outlines, pavements_of(streets), buildings, lines)
    usual: dict[str, Any] = {
        "connected_order": inbound_first(slots),
        "footways": footways_of(streets),
        "cycleways": cycleways_of(streets),
    }
    return Layout(
        network=network,
        slots=slots,
        rsus=rsus,
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(0.0, SPEED_M_S / 2, SPEED_M_S),
        static=(*town_parts(road_map, stripes_of(streets, arms), buildings, rsus, RSU_HEIGHT_M), *parts),
        road_map=road_map,
        flights=flights_around(np.zeros(2)),
        **usual | rest,
    )


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
    buildings = row_of_buildings(streets.corner_m, 1) + row_of_buildings(streets.corner_m, -1)
    strips = [rectangle((-_ROW_M, _ROW_M), span) for span in ((-streets.kerb_m, -LANE_M), (LANE_M, streets.kerb_m))]
    surface = [quad for lane in network.lanes.values() for quad in lane_outline(lane)] + strips
    rsus = corner_units(9.5, streets.kerb_m + 5.5)
    rest = {"footways": footways, "cycleways": None, "bays": bays}
    return town_layout(streets, network, surface, (buildings, ()), rsus, crosswalks, **rest)


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
