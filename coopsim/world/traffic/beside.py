"""Lanes beside a way that lead the same way, found by where they are: in maps each lane may be a road of its own."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.traffic.lane_geometry import distance_to_box, heading_at, local_coordinates
from coopsim.world.traffic.lanes import LaneArrays

_MOST = 3  # lanes beside that are looked for, on either side
_OFF = 0.4  # share of its width by which a lane may lie nearer or farther than beside the next one
_PARALLEL = 0.97  # least cosine between the headings of lanes that lead the same way
_BEYOND_M = 0.5  # lanes that follow each other may leave a gap


@njit(cache=True, nogil=True)
def lanes_beside(network: LaneArrays, points: Floats, numbers: Ints, crosses: Mask) -> Ints:
    """Return how many lanes (K, 2) lie side by side to the left and to the right of places of a way.

    Args:
        network: the roads.
        points: (K, 2) m, places in the middle of lanes.
        numbers: (K,) of these lanes.
        crosses: (R,) roads that lead over junctions, where no lane counts as beside another.
    """
    beside = np.zeros((len(points), 2), np.int64)
    near, count = np.empty(len(network.lanes), np.int64), 0
    for k in range(len(points) - 1):
        if k == 0 or numbers[k] != numbers[k - 1]:
            count = _near_lanes(network, numbers[k], crosses, near)
        if crosses[network.lanes[numbers[k]].road]:
            continue
        heading = math.atan2(points[k + 1, 1] - points[k, 1], points[k + 1, 0] - points[k, 0])
        at = _places(network, points[k], heading, near[:count], network.lanes[numbers[k]].width)
        for side in range(2):
            while beside[k, side] < _MOST and at[side, beside[k, side]]:
                beside[k, side] += 1
    beside[-1] = beside[-2]
    return beside


@njit(cache=True, nogil=True)
def _near_lanes(network: LaneArrays, number: int, crosses: Mask, near: Ints) -> int:
    """Write the numbers of the lanes whose boxes are near that of a lane; return how many there are."""
    own, count = network.lanes[number], 0
    reach_m = (_MOST + 1) * own.width
    for k in range(len(network.lanes)):
        lane = network.lanes[k]
        x, y = min(max(lane.low_x, own.low_x), own.high_x), min(max(lane.low_y, own.low_y), own.high_y)
        free = k != number and not lane.forbidden and not crosses[lane.road]
        if free and distance_to_box(lane, x, y) <= reach_m:
            near[count] = k
            count += 1
    return count


@njit(cache=True, nogil=True)
def _places(network: LaneArrays, point: Floats, heading: float, near: Ints, width_m: float) -> Mask:
    """Return whether there is a lane (2, `_MOST`) at each whole number of widths to the left and to the right."""
    there = np.zeros((2, _MOST), np.bool_)
    for k in near:
        lane = network.lanes[k]
        along, aside = local_coordinates(lane, network.corners, point[0], point[1])
        widths = round(abs(aside) / width_m)
        if not (1 <= widths <= _MOST and -_BEYOND_M <= along <= lane.length + _BEYOND_M):
            continue
        parallel = math.cos(heading - heading_at(lane, network.corners, along)) > _PARALLEL
        if parallel and abs(abs(aside) - widths * width_m) < _OFF * width_m:
            there[0 if aside < 0 else 1, widths - 1] = True
    return there
