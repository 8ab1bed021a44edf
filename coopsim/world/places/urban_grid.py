"""The layout `urban_grid`: nine junctions, three by three, and the four blocks of buildings between them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.places.layout import LANE_M, Footways, Layout, StartSlot, flights_around, lane_outline, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import Building, lane_lines, town_map, town_parts
from coopsim.world.places.streets import (
    RSU_HEIGHT_M,
    SPEED_M_S,
    Streets,
    add_straight,
    add_turns,
    crosswalk_of,
    middle_of,
    place,
    place_all,
    spaced_slots,
    stripes_of,
)

_BLOCK_M = 100.0  # from junction to junction
_WALK_M = 6.5  # from a street's middle line to where people walk
_HOUSE_M = 12.0  # from a street's middle line to a building
_UNIT_M = 9.5
_FREE_M = 14.0  # before a stop line, where a starting vehicle could not stop
_PLACES = [(i, j) for j in (-1, 0, 1) for i in (-1, 0, 1)]
_STEP = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Directions of arms, in quarter turns from the x axis."""


def make_urban_grid() -> Layout:
    """Build nine junctions, three by three, and four blocks of buildings; it has no randomness."""
    network = RoadNetwork()
    junctions = {spot: Streets(arms=tuple(arm for arm in range(4) if _next(spot, arm) in _PLACES)) for spot in _PLACES}
    movements: list[tuple[str, str]] = []
    for spot, streets in junctions.items():
        for arm in streets.arms:
            _add_street(network, spot, arm, streets.stop_m)
        # The bends at the grid's corners, too: two trucks do not fit past each other there.
        movements += add_turns(network, streets, _middle(spot), partial(_node, spot))
    crossed = [(spot, streets) for spot, streets in junctions.items() if len(streets.arms) > 2]
    slots = tuple(
        slot
        for spot, streets in junctions.items()
        for arm in streets.arms
        for slot in spaced_slots(
            (_node(spot, "exit", arm), _node(_next(spot, arm), "stop", arm + 2), 0),
            _BLOCK_M - 2 * streets.stop_m - _FREE_M,
        )
    )
    rsus = tuple(_unit(spot) for spot in ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)))
    buildings = _buildings()
    lanes = [quad for lane in network.lanes.values() for quad in lane_outline(lane)]
    lanes += [_middle(spot) + part for spot, streets in crossed for part in middle_of(streets)]
    crosswalks = [_middle(spot) + crosswalk_of(streets, arm) for spot, streets in crossed for arm in streets.arms]
    stripes = [_middle(spot) + stripe for spot, streets in crossed for stripe in stripes_of(streets)]
    road_map = town_map(lanes, crosswalks, _pavements(junctions), buildings, lane_lines(network, movements))
    return Layout(
        network=network,
        slots=slots,
        connected_order=_connected_order(slots),
        footways=_footways(junctions),
        rsus=rsus,
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(0.0, SPEED_M_S / 2, SPEED_M_S),
        static=town_parts(road_map, stripes, buildings, rsus, RSU_HEIGHT_M),
        road_map=road_map,
        movements=tuple(movements),
        flights=flights_around(np.zeros(2)),
    )


def _next(spot: tuple[int, int], arm: int) -> tuple[int, int]:
    dx, dy = _STEP[arm % 4]
    return spot[0] + dx, spot[1] + dy


def _node(spot: tuple[int, int], name: str, arm: int) -> str:
    return f"{name}{spot[0]}{spot[1]}_{arm % 4}"


def _middle(spot: tuple[int, int]) -> Floats:
    return _BLOCK_M * np.array(spot, dtype=np.float64)


def _add_street(network: RoadNetwork, spot: tuple[int, int], arm: int, stop_m: float) -> None:
    """Add a street from a junction's exit to the next one's stop line."""
    ends = tuple(_middle(spot) + place(arm, (x, -LANE_M / 2)) for x in (stop_m, _BLOCK_M - stop_m))
    road = _node(spot, "exit", arm), _node(_next(spot, arm), "stop", arm + 2)
    add_straight(network, road, (ends[0], ends[1]))


def _connected_order(slots: tuple[StartSlot, ...]) -> tuple[int, ...]:
    """Rank slots: towards the middle junction, nearest first, each next one on another arm; then the rest."""

    def rank(index: int) -> tuple[bool, float, str]:
        start, end, _ = slots[index].lane
        return (not end.startswith("stop00_"), -slots[index].along_m, start)

    return tuple(sorted(range(len(slots)), key=rank))


def _footways(junctions: Mapping[tuple[int, int], Streets]) -> Footways:
    """Return ways along both sides of every street, around corners, and over the arms where more than two meet."""
    keys = [(spot, arm, side) for spot, streets in junctions.items() for arm in streets.arms for side in (1, -1)]
    number = {key: k for k, key in enumerate(keys)}
    nodes = [_middle(spot) + place(arm, (junctions[spot].crosswalk_m, side * _WALK_M)) for spot, arm, side in keys]
    crossing, linked = np.zeros((2, len(keys), len(keys)), dtype=bool)
    for (spot, arm, side), k in number.items():
        linked[k, number[_next(spot, arm), (arm + 2) % 4, -side]] = True
        if len(junctions[spot].arms) > 2:
            across = number[spot, arm, -side]
            linked[k, across] = crossing[k, across] = True
        # Around the corner, or straight on where the next arm is missing; not around a bend's outside.
        for turn in (1, 2):
            around = spot, (arm + side * turn) % 4, -side
            if around in number:
                linked[k, number[around]] = True
                break
    return Footways.linking(nodes, linked, crossing)


def _pavements(junctions: Mapping[tuple[int, int], Streets]) -> list[Floats]:
    """Return strips along both sides of every street; straight on where one arm is missing."""
    low, high = LANE_M, LANE_M + 3.0
    straight_on = [
        _middle(spot) + place_all(arm, rectangle((low, high), (-low, low)))
        for spot, streets in junctions.items()
        for arm in range(4)
        if len(streets.arms) == 3 and arm not in streets.arms
    ]
    return straight_on + [
        _middle(spot) + place_all(arm, rectangle((low, _BLOCK_M - low), span))
        for spot in _PLACES
        for arm in (0, 1)
        if _next(spot, arm) in _PLACES
        for span in ((low, high), (-high, -low))
    ]


def _buildings() -> list[Building]:
    """Return four buildings on every block, with a gap between them, and a row outside the grid on every side."""
    near, far, middle = _HOUSE_M, _BLOCK_M - _HOUSE_M, _BLOCK_M / 2
    halves = ((near, middle - 4.0), (middle + 4.0, far))
    sides = [*halves, *((-high, -low) for low, high in halves)]
    heights = (12.0, 18.0, 9.0, 15.0, 21.0)
    inside = [(x, y) for x in sides for y in sides]
    edge = _BLOCK_M + _HOUSE_M
    outside = [(row, span) for span in sides for row in ((edge, edge + 14.0), (-edge - 14.0, -edge))]
    outside += [(span, row) for row, span in outside]
    return [(x, y, heights[k % len(heights)]) for k, (x, y) in enumerate(inside + outside)]


def _unit(spot: tuple[int, int]) -> SE3:
    """Return a place on a corner of a junction, facing its middle."""
    x, y = _middle(spot) + _UNIT_M
    return SE3.from_xyz_yaw([x, y, 0.0], -3 * np.pi / 4)
