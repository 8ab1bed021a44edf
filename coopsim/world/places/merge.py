"""The layout `merge`: a slip road joins a main road, one vehicle from each in turn, behind a noise barrier.

Both roads are closed: at the east end the main road turns round, at the west end it divides into its own way back and,
around that, the slip road's.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3
from coopsim.world.places.layout import (
    LANE_M,
    MARKING,
    Layout,
    StartSlot,
    box_part,
    flat_part,
    flights_around,
    lane_outline,
    rectangle,
)
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.scenery import lane_lines, town_map, town_parts
from coopsim.world.places.streets import add_bend, add_straight, spaced_slots
from coopsim.world.snapshot import StaticPart

_HALF_M = 22.0  # between the main road's two directions, and radius of its turns
_EAST_M, _WEST_M = 150.0, -150.0  # ends of its straight part
_SLIP_M = 16.0  # between the main road and the slip road, before that bends
_BEND_M = 60.0  # radius of the slip road's bends
_LINE_M = 34.0  # from the main road's stop line to where the slip road joins
_OUT_M = 30.0  # how much farther west the slip road turns
_MAIN_SPEED_M_S, _SLIP_SPEED_M_S, _TURN_SPEED_M_S = 14.0, 11.0, 8.0
_BARRIER_HEIGHT_M = 3.0
_MAST_M = 6.0
_VERGE_M = 0.8  # from the edge of the main road to a barrier beside it


def make_merge(hidden_m: float | None = None) -> Layout:
    """Build a slip road that joins a main road behind a noise barrier; the layout has no randomness.

    Args:
        hidden_m: distance between the end of a barrier at the edge of the main road and the place where the roads meet;
            None: the barrier stands half-way between the roads.
    """
    network = RoadNetwork()
    _add_main_road(network)
    _add_slip_road(network)
    slots = tuple(
        slot
        for start, end in (
            ("west", "line"),
            ("ramp", "bend"),
            ("join", "east"),
            ("north_east", "north_west"),
            ("north_west", "out"),
        )
        for slot in spaced_slots((start, end, 0), network.get_lane((start, end, 0)).length)
    )
    rsus = tuple(
        SE3.from_xyz_yaw([x, y, 0.0], float(exact.arctan2(-_HALF_M - y, -x)))
        for x, y in ((5.0, -_HALF_M - 8.0), (-60.0, -_HALF_M + 8.0), (40.0, -_HALF_M + 8.0), (-60.0, _HALF_M + 8.0))
    )
    lanes = [quad for lane in network.lanes.values() for quad in lane_outline(lane)]
    road_map = town_map(lanes, [], [], [], lane_lines(network))
    return Layout(
        network=network,
        slots=slots,
        connected_order=_connected_order(slots),
        rsus=rsus,
        rsu_height_m=_MAST_M,
        speeds_m_s=(0.0, _MAIN_SPEED_M_S / 2, _MAIN_SPEED_M_S),
        static=(*town_parts(road_map, [], [], rsus, _MAST_M), *_roadside(hidden_m)),
        road_map=road_map,
        movements=(("line", "join"), ("give_way", "join")),
        flights=flights_around(np.array([0.0, -_HALF_M])),
    )


def _add_main_road(network: RoadNetwork) -> None:
    south, north = -_HALF_M, _HALF_M
    for start, end, x, y in (
        ("west", "line", (_WEST_M, -_LINE_M), south),
        ("line", "join", (-_LINE_M, 0.0), south),
        ("join", "east", (0.0, _EAST_M), south),
        ("north_east", "north_west", (_EAST_M, _WEST_M), north),
    ):
        add_straight(network, (start, end), (np.array([x[0], y]), np.array([x[1], y])), _MAIN_SPEED_M_S)
    half = np.pi / 2
    for start, end, x_m, first in (("east", "north_east", _EAST_M, -half), ("north_west", "west", _WEST_M, half)):
        # In two halves: a lane is an arc of at most half a turn.
        apex = f"{start}_apex"
        for road, angle in (((start, apex), first), ((apex, end), first + half)):
            add_bend(network, road, np.array([x_m, 0.0]), (_HALF_M, angle, angle + half), _TURN_SPEED_M_S)


def _add_slip_road(network: RoadNetwork) -> None:
    """Add the slip road: straight on where the main road turns, around that turn, and by two bends to the main road."""
    far, radius = _WEST_M - _OUT_M, _HALF_M + _SLIP_M / 2
    angle = float(exact.arccos(1 - _SLIP_M / (2 * _BEND_M)))
    start_m = -2 * _BEND_M * float(exact.sin(angle))
    slip = -_HALF_M - _SLIP_M
    north_west, out = np.array([_WEST_M, _HALF_M]), np.array([far, _HALF_M])
    add_straight(network, ("north_west", "out"), (north_west, out), _SLIP_SPEED_M_S)
    centre, half = np.array([far, -_SLIP_M / 2]), np.pi / 2
    add_bend(network, ("out", "out_apex"), centre, (radius, half, np.pi), _TURN_SPEED_M_S)
    add_bend(network, ("out_apex", "ramp"), centre, (radius, np.pi, 3 * half), _TURN_SPEED_M_S)
    add_straight(network, ("ramp", "bend"), (np.array([far, slip]), np.array([start_m, slip])), _SLIP_SPEED_M_S)
    left, right = np.array([start_m, slip + _BEND_M]), np.array([0.0, -_HALF_M - _BEND_M])
    add_bend(network, ("bend", "give_way"), left, (_BEND_M, -half, -half + angle), _SLIP_SPEED_M_S)
    add_bend(network, ("give_way", "join"), right, (_BEND_M, half + angle, half), _SLIP_SPEED_M_S)


def _connected_order(slots: tuple[StartSlot, ...]) -> tuple[int, ...]:
    """Return the order of slots: cars about to meet, nearest first and from both roads in turn; then the rest."""

    def rank(index: int) -> tuple[bool, int, bool]:
        same_lane = [other for other in slots if other.lane == slots[index].lane]
        queue = sum(other.along_m > slots[index].along_m for other in same_lane)
        start = slots[index].lane[0]
        return (start not in ("west", "ramp"), queue, start == "ramp")

    return tuple(sorted(range(len(slots)), key=rank))


def _roadside(hidden_m: float | None) -> list[StaticPart]:
    """Build the barrier that hides the two roads from each other, another behind the main road, and edge lines."""
    barrier = ((_WEST_M, -55.0), -_HALF_M - _SLIP_M / 2)
    if hidden_m is not None:
        barrier = ((_WEST_M, -hidden_m), -_HALF_M - LANE_M / 2 - _VERGE_M)
    walls = [
        barrier,
        ((_WEST_M, _EAST_M), -_HALF_M + 5.0),
        ((_WEST_M, _EAST_M), _HALF_M - 5.0),
        ((_WEST_M, _EAST_M), _HALF_M + 6.0),
        ((10.0, _EAST_M), -_HALF_M - 6.0),
        ((_WEST_M, -70.0), -_HALF_M - _SLIP_M - 6.0),
    ]
    lines = [
        rectangle((_WEST_M, _EAST_M), (y - 0.1, y + 0.1))
        for y in (_HALF_M - LANE_M / 2, _HALF_M + LANE_M / 2, -_HALF_M + LANE_M / 2)
    ]
    return [
        *(
            box_part("wall", (x[0], y - 0.15, 0.0), (x[1], y + 0.15, _BARRIER_HEIGHT_M), (150, 140, 120))
            for x, y in walls
        ),
        flat_part("marking", lines, 0.02, MARKING, 0.8),
    ]
