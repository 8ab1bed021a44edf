"""Coordinates of lanes as kernels.

`along` and `aside` are coordinates of a lane, m; aside is positive to the left of the direction of travel (in this
world, whose y points up; highway-env draws it downwards). `corners` are those of the network's polylines.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from coopsim.support.kernels import njit
from coopsim.world.places.polyline import polyline_coordinates, polyline_heading, polyline_position, polyline_radius
from coopsim.world.traffic.lanes import CIRCULAR, POLYLINE, LaneRow
from coopsim.world.traffic.rules import wrap


@njit(cache=True, nogil=True)
def local_coordinates(lane: LaneRow, corners: NDArray[Any], x: float, y: float) -> tuple[float, float]:
    """Return along and aside of a place."""
    if lane.kind == POLYLINE:
        return polyline_coordinates(corners, lane.first_corner, lane.corners, x, y)
    dx, dy = x - lane.x, y - lane.y
    if lane.kind == CIRCULAR:
        # Adding and subtracting the start phase rounds as highway-env does.
        phase = lane.start_phase + wrap(math.atan2(dy, dx) - lane.start_phase)
        along = lane.turn * (phase - lane.start_phase) * lane.radius
        return along, lane.turn * (lane.radius - math.sqrt(dx * dx + dy * dy))
    return dx * lane.dir_x + dy * lane.dir_y, dy * lane.dir_x - dx * lane.dir_y


@njit(cache=True, nogil=True)
def position_at(lane: LaneRow, corners: NDArray[Any], along: float) -> tuple[float, float]:
    """Return a place on the middle line."""
    if lane.kind == POLYLINE:
        return polyline_position(corners, lane.first_corner, lane.corners, along)
    if lane.kind == CIRCULAR:
        phase = lane.turn * along / lane.radius + lane.start_phase
        return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)
    return lane.x + along * lane.dir_x, lane.y + along * lane.dir_y


@njit(cache=True, nogil=True)
def heading_at(lane: LaneRow, corners: NDArray[Any], along: float) -> float:
    """Return the heading of the middle line, rad."""
    if lane.kind == POLYLINE:
        return polyline_heading(corners, lane.first_corner, lane.corners, along)
    if lane.kind == CIRCULAR:
        return lane.turn * along / lane.radius + lane.start_phase + math.pi / 2 * lane.turn
    return lane.heading


@njit(cache=True, nogil=True)
def radius_at(lane: LaneRow, corners: NDArray[Any], along: float) -> float:
    """Return the radius of the bend at a distance along a lane, m; infinite where it is straight."""
    if lane.kind == POLYLINE:
        return polyline_radius(corners, lane.first_corner, lane.corners, along)
    return lane.radius


@njit(cache=True, nogil=True)
def distance_to(lane: LaneRow, corners: NDArray[Any], x: float, y: float) -> float:
    """Return how far aside plus how far before the start or past the end a place is."""
    along, aside = local_coordinates(lane, corners, x, y)
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0)


@njit(cache=True, nogil=True)
def distance_to_box(lane: LaneRow, x: float, y: float) -> float:
    """Return the distance to the box around the middle line, a lower bound of `distance_to`."""
    dx = max(lane.low_x - x, 0.0, x - lane.high_x)
    dy = max(lane.low_y - y, 0.0, y - lane.high_y)
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True, nogil=True)
def closest_lane(lanes: NDArray[Any], corners: NDArray[Any], x: float, y: float, heading: float, guess: int) -> int:
    """Return the lane with the least sum of distance (m) and angle (rad), the first of equals.

    `guess` only saves time.
    """
    best = guess
    least = _distance_with_heading(lanes[guess], corners, x, y, heading)
    for k in range(len(lanes)):
        if distance_to_box(lanes[k], x, y) > least + 1e-9:
            continue
        distance = _distance_with_heading(lanes[k], corners, x, y, heading)
        if distance < least or (distance == least and k < best):
            best, least = k, distance
    return best


@njit(cache=True, nogil=True)
def _distance_with_heading(lane: LaneRow, corners: NDArray[Any], x: float, y: float, heading: float) -> float:
    along, aside = local_coordinates(lane, corners, x, y)
    angle = abs(wrap(heading - heading_at(lane, corners, along)))
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0) + angle
