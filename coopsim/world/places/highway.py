"""The layouts `highway` and `platoon`: two straight carriageways of three lanes.

Traffic is kept up around the connected cars; in a platoon, these follow each other closely in one lane.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import SE3
from coopsim.world.places.layout import (
    ASPHALT,
    GROUND,
    LANE_M,
    MARKING,
    STEEL,
    Layout,
    StartSlot,
    box_part,
    flat_part,
    flights_around,
    post_part,
    rectangle,
)
from coopsim.world.places.road_network import RoadNetwork, StraightLane
from coopsim.world.snapshot import RoadMap

LANES = 3
MEDIAN_M = 4.0
START_M, END_M = -2_000.0, 120_000.0  # an hour at 33 m/s
SCENERY_M = 12_000.0  # scenery ends here: far from most episodes' end
SLOT_SPACING_M = 24.0
SPREAD_M = 170.0
WINDOW_M = 220.0
SPEED_M_S = 28.0
CRUISE_M_S = 25.0  # below every lane's limit
PLATOON_GAP_S = 0.4
PLATOON_SPEED_M_S = 22.0  # well below the lane's limit, so that cars can close up
PLATOON_CARS = 6
PLATOON_LANE = 1  # the middle: others pass on both sides
PLATOON_HEAD_M = 60.0  # its first car starts behind this
RSU_Y_M = -18.5
RSU_HEIGHT_M = 6.0


def make_highway() -> Layout:
    """Build two straight carriageways of three lanes; the layout has no parameters and no randomness."""
    network = RoadNetwork()
    for lane in range(LANES):
        # Lane 0 is the leftmost in the direction of travel, so that "lane left" is to the left.
        offset = (MEDIAN_M + LANE_M) / 2 + lane * LANE_M
        for name, side in (("east", -1), ("west", 1)):
            ends = np.array([[START_M, side * offset], [END_M, side * offset]])
            if side > 0:
                ends = ends[::-1]
            network.add_lane(
                f"{name}_start",
                f"{name}_end",
                StraightLane(ends[0], ends[1], width=LANE_M, speed_limit=SPEED_M_S + 6 - 3 * lane),
            )
    edge = MEDIAN_M / 2 + LANES * LANE_M
    carriageways = [rectangle((START_M, END_M), sides) for sides in ((-edge, -MEDIAN_M / 2), (MEDIAN_M / 2, edge))]
    slots, lines = _slots(network), tuple(_lines(edge))
    rsus = tuple(SE3.from_xyz_yaw([100.0 * k, RSU_Y_M * (-1) ** k, 0.0], np.pi / 2 * (-1) ** k) for k in range(4))
    shown = [rectangle((START_M, SCENERY_M), tuple(part[[0, 2], 1])) for part in carriageways]
    return Layout(
        network=network,
        slots=slots,
        connected_order=_connected_order(slots),
        rsus=rsus,
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(20.0, CRUISE_M_S, 30.0),
        static=(
            flat_part("ground", [rectangle((START_M, END_M), (-300.0, 300.0))], -0.04, GROUND, 0.3),
            flat_part("road", carriageways, 0.0, ASPHALT, 0.18),
            flat_part("marking", list(lines), 0.02, MARKING, 0.8),
            box_part("barrier", (START_M, -0.3, 0.0), (END_M, 0.3, 0.85), STEEL),
            box_part("wall", (START_M, edge + 9, 0.0), (SCENERY_M, edge + 9.4, 3.5), (150, 140, 120)),
            box_part("wall", (START_M, -edge - 9.4, 0.0), (SCENERY_M, -edge - 9, 3.5), (150, 140, 120)),
            *(
                post_part("lamp", np.array([x, side * (edge + 6)]), 9.0)
                for x in np.arange(-400.0, 2_000.0, 60.0)
                for side in (-1, 1)
            ),
            *(post_part("mast", rsu.translation[:2], RSU_HEIGHT_M) for rsu in rsus),
        ),
        road_map=RoadMap(tuple(shown), (), (), (), lines),
        window_m=WINDOW_M,
        cruise_m_s=CRUISE_M_S,
        flights=flights_around(np.zeros(2), drift_m_s=(CRUISE_M_S, 0.0)),
    )


def make_platoon() -> Layout:
    """Build the highway, on which possibly connected cars keep to one lane, at `PLATOON_GAP_S`."""
    highway = make_highway()

    def rank(index: int) -> tuple[bool, bool, float]:
        slot = highway.slots[index]
        ahead_m = slot.along_m + START_M - PLATOON_HEAD_M
        in_lane = slot.lane == ("east_start", "east_end", PLATOON_LANE)
        return (not in_lane, ahead_m > 0, abs(ahead_m))

    order = tuple(sorted(range(len(highway.slots)), key=rank))
    return replace(
        highway,
        connected_order=order,
        cars_first=PLATOON_CARS,
        convoy_gap_s=PLATOON_GAP_S,
        cruise_m_s=PLATOON_SPEED_M_S,
        speeds_m_s=(PLATOON_SPEED_M_S - 5.0, PLATOON_SPEED_M_S, PLATOON_SPEED_M_S + 5.0),
        flights=flights_around(np.zeros(2), drift_m_s=(PLATOON_SPEED_M_S, 0.0)),
    )


def _slots(network: RoadNetwork) -> tuple[StartSlot, ...]:
    slots = []
    for name in ("east", "west"):
        for lane in range(LANES):
            index = (f"{name}_start", f"{name}_end", lane)
            middle = network.get_lane(index).local_coordinates(np.zeros(2))[0]
            # Lanes are staggered, so that cars do not begin side by side.
            first = middle - SPREAD_M + lane * SLOT_SPACING_M / LANES
            slots += [StartSlot(index, float(x)) for x in np.arange(first, first + 2 * SPREAD_M + 1, SLOT_SPACING_M)]
    return tuple(slots)


def _connected_order(slots: tuple[StartSlot, ...]) -> tuple[int, ...]:
    """Rank slots: cars going east, from the middle outwards, the passing lane's last; then the others."""

    def rank(index: int) -> tuple[bool, bool, float]:
        slot = slots[index]
        along = slot.along_m + START_M if slot.lane[0].startswith("east") else END_M - slot.along_m
        return (slot.lane[0].startswith("west"), slot.lane[2] == 0, abs(along))

    return tuple(sorted(range(len(slots)), key=rank))


def _lines(edge: float) -> list[np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    """Return edge lines, solid, and lane lines, dashed where episodes begin."""
    solid = [
        rectangle((START_M, SCENERY_M), (y - 0.1, y + 0.1))
        for side in (-1, 1)
        for y in (side * (MEDIAN_M / 2 + 0.3), side * (edge - 0.3))
    ]
    dashed = [
        rectangle((x, x + 4.0), (y - 0.08, y + 0.08))
        for x in np.arange(-400.0, 2_000.0, 12.0)
        for side in (-1, 1)
        for y in (side * (MEDIAN_M / 2 + lane * LANE_M) for lane in range(1, LANES))
    ]
    return solid + dashed
