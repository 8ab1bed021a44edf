"""Neighbours on lanes: lists of the bodies near each lane, sorted along it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic.fleet import Body
from coopsim.world.traffic.lane_geometry import distance_to_box, heading_at, local_coordinates
from coopsim.world.traffic.lanes import LaneArrays, LaneRow
from coopsim.world.traffic.rules import NEAR_M, VEHICLE_LENGTH_M

_ON_LANE_M = 1.0  # bodies up to this far outside a lane are on it


class LaneLists(NamedTuple):
    """Bodies near each lane, in order along it.

    Attributes:
        first: (L,) index of a lane's first entry.
        entries: (L,) number of its entries.
        body: (E,) number of the body.
        along: (E,) m; increasing within a lane, equal ones by number.
        aside: (E,) m.
        pokes: (E,) m, by which a steered body that is askew reaches farther aside than one that goes along the lane.
    """

    first: Ints
    entries: Ints
    body: Ints
    along: Floats
    aside: Floats
    pokes: Floats


class Scene(NamedTuple):
    """Input of all drivers in one step; functions that take one are inlined, because passing it is slow.

    Attributes:
        network: the roads.
        rows: (N,) `VEHICLE`.
        routes: (N, K, 2), see `Fleet`.
        bodies: (N + M,) `BODY`: the N vehicles, then people.
        lists: bodies near each lane.
    """

    network: LaneArrays
    rows: NDArray[Any]
    routes: Ints
    bodies: NDArray[Any]
    lists: LaneLists


@njit(cache=True, nogil=True)
def list_along_lanes(network: LaneArrays, bodies: NDArray[Any]) -> LaneLists:
    """Sort bodies into the lanes that they are near; a body may be near several."""
    lanes, corners = network.lanes, network.corners
    capacity = np.zeros(len(lanes), dtype=np.int64)
    for k in range(len(lanes)):
        for i in range(len(bodies)):
            capacity[k] += _may_be_near(lanes[k], bodies[i])
    first = np.cumsum(capacity) - capacity
    count = np.zeros(len(lanes), dtype=np.int64)
    number = np.empty(capacity.sum(), dtype=np.int64)
    along, aside, pokes = np.empty(len(number)), np.empty(len(number)), np.empty(len(number))
    for k in range(len(lanes)):
        lane: LaneRow = lanes[k]
        for i in range(len(bodies)):
            if not _may_be_near(lane, bodies[i]):
                continue
            s, d = local_coordinates(lane, corners, bodies[i].x, bodies[i].y)
            within = -VEHICLE_LENGTH_M <= s < lane.length + VEHICLE_LENGTH_M
            if not within or abs(d) > lane.width / 2 + NEAR_M:
                continue
            # Insertion sort: a lane has tens of bodies, mostly in order.
            entry = first[k] + count[k]
            while entry > first[k] and along[entry - 1] > s:
                number[entry], along[entry], aside[entry] = number[entry - 1], along[entry - 1], aside[entry - 1]
                pokes[entry] = pokes[entry - 1]
                entry -= 1
            number[entry], along[entry], aside[entry] = i, s, d
            pokes[entry] = _pokes(bodies[i], heading_at(lane, corners, s)) if bodies[i].steered else 0.0
            count[k] += 1
    return LaneLists(first, count, number, along, aside, pokes)


@njit(cache=True, nogil=True)
def _pokes(body: Body, heading: float) -> float:
    angle = body.heading - heading
    return (abs(math.cos(angle)) * body.width + abs(math.sin(angle)) * body.length - body.width) / 2


@njit(cache=True, nogil=True)
def _may_be_near(lane: LaneRow, body: Body) -> bool:
    return distance_to_box(lane, body.x, body.y) <= lane.width / 2 + NEAR_M + VEHICLE_LENGTH_M


@njit(cache=True, nogil=True)
def first_from(lists: LaneLists, lane: int, along: float) -> int:
    """Return the lane's first entry at `along` or farther; one past its last if there is none."""
    low: int = lists.first[lane]
    high: int = lists.first[lane] + lists.entries[lane]
    while low < high:
        middle = (low + high) // 2
        if lists.along[middle] < along:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def in_front(lists: LaneLists, lanes: NDArray[Any], lane: int, me: int, along: float) -> int:
    """Return the next body on the lane at `along` or farther, the last of equals; -1: none."""
    found, end = -1, lists.first[lane] + lists.entries[lane]
    limit, nearest = lanes[lane].width / 2 + _ON_LANE_M, np.inf
    for entry in range(first_from(lists, lane, along), end):
        if lists.along[entry] > nearest:
            break
        if lists.body[entry] != me and abs(lists.aside[entry]) - lists.pokes[entry] <= limit:
            found, nearest = lists.body[entry], lists.along[entry]
    return found


@njit(cache=True, nogil=True)
def behind(lists: LaneLists, lanes: NDArray[Any], lane: int, me: int, along: float) -> int:
    """Return the next body on the lane before `along`, the first of equals; -1: none."""
    found, start = -1, lists.first[lane]
    limit, nearest = lanes[lane].width / 2 + _ON_LANE_M, -np.inf
    for entry in range(first_from(lists, lane, along) - 1, start - 1, -1):
        if lists.along[entry] < nearest:
            break
        if lists.body[entry] != me and abs(lists.aside[entry]) - lists.pokes[entry] <= limit:
            found, nearest = lists.body[entry], lists.along[entry]
    return found
