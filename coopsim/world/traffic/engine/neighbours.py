"""Who is in front and who is behind on a lane: lists of everybody near a lane, sorted along it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import Body
from coopsim.world.traffic.engine.lanes import VEHICLE_LENGTH_M, Lane, distance_to_box, local_coordinates

ON_LANE_M = 1.0
"""Who is at most this far outside a lane is on it, for those who look for neighbours."""

NEAR_M = 4.0
"""Who is at most this far outside is listed: people who are about to step into a lane are seen before."""


class LaneLists(NamedTuple):
    """Bodies near each lane, in order along it.

    Attributes:
        first: (L,) where a lane's entries start.
        entries: (L,) how many it has.
        who: (E,) number of the body.
        along: (E,) m; increasing within a lane, equal ones by number.
        aside: (E,) m.
    """

    first: Ints
    entries: Ints
    who: Ints
    along: Floats
    aside: Floats


@njit(cache=True, nogil=True)
def list_along_lanes(lanes: NDArray[Any], bodies: NDArray[Any]) -> LaneLists:
    """Sort bodies into the lanes that they are near; one may be near several."""
    room = np.zeros(len(lanes), dtype=np.int64)
    for k in range(len(lanes)):
        for i in range(len(bodies)):
            room[k] += _may_be_near(lanes[k], bodies[i])
    first = np.cumsum(room) - room
    count = np.zeros(len(lanes), dtype=np.int64)
    who = np.empty(room.sum(), dtype=np.int64)
    along, aside = np.empty(len(who)), np.empty(len(who))
    for k in range(len(lanes)):
        lane: Lane = lanes[k]
        for i in range(len(bodies)):
            if not _may_be_near(lane, bodies[i]):
                continue
            s, d = local_coordinates(lane, bodies[i].x, bodies[i].y)
            within = -VEHICLE_LENGTH_M <= s < lane.length + VEHICLE_LENGTH_M
            if not within or abs(d) > lane.width / 2 + NEAR_M:
                continue
            # Sorting by insertion: a lane has tens of bodies, which mostly come in order.
            entry = first[k] + count[k]
            while entry > first[k] and along[entry - 1] > s:
                who[entry], along[entry], aside[entry] = who[entry - 1], along[entry - 1], aside[entry - 1]
                entry -= 1
            who[entry], along[entry], aside[entry] = i, s, d
            count[k] += 1
    return LaneLists(first, count, who, along, aside)


@njit(cache=True, nogil=True)
def _may_be_near(lane: Lane, body: Body) -> bool:
    return distance_to_box(lane, body.x, body.y) <= lane.width / 2 + NEAR_M + VEHICLE_LENGTH_M


@njit(cache=True, nogil=True)
def first_from(lists: LaneLists, lane: int, along: float) -> int:
    """The lane's first entry that is at `along` or farther; one past its last if there is none."""
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
    """The body on the lane that is next at `along` or farther, the last of equals; -1: nobody."""
    found, end = -1, lists.first[lane] + lists.entries[lane]
    limit, nearest = lanes[lane].width / 2 + ON_LANE_M, np.inf
    for entry in range(first_from(lists, lane, along), end):
        if lists.along[entry] > nearest:
            break
        if lists.who[entry] != me and abs(lists.aside[entry]) <= limit:
            found, nearest = lists.who[entry], lists.along[entry]
    return found


@njit(cache=True, nogil=True)
def behind(lists: LaneLists, lanes: NDArray[Any], lane: int, me: int, along: float) -> int:
    """The body on the lane that is next before `along`, the first of equals; -1: nobody."""
    found, start = -1, lists.first[lane]
    limit, nearest = lanes[lane].width / 2 + ON_LANE_M, -np.inf
    for entry in range(first_from(lists, lane, along) - 1, start - 1, -1):
        if lists.along[entry] < nearest:
            break
        if lists.who[entry] != me and abs(lists.aside[entry]) <= limit:
            found, nearest = lists.who[entry], lists.along[entry]
    return found
