"""Right of way where roads meet: constants, conflicts and roles of movements, for either engine.

A movement is a road over a junction, from stop line to exit. Vehicles ask for theirs; the first to ask goes first, and
a vehicle that would cross one that waits longer waits, too, so none starves.

A vehicle bars a movement only until its tail is past the place where the two come close. A vehicle that waits for space
behind the junction, or in line behind such a one, does not bar those at the head of their lines: queues around a block
would wait for each other for ever. Nor does one with priority, in line behind one that gives way. A vehicle that stands
at the head of a line turns elsewhere if the exit that it wanted is full.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import CircularLane, Lane, Road, RoadNetwork

REQUEST_M = 32.0
"""Distance to the stop line from which on a vehicle asks."""

EXIT_SPACE_M = 9.0
"""Free length needed behind the last vehicle on the exit: no vehicle waits on the junction."""

EXIT_HALF_WIDTH_M = 2.5

SLOW_M_S = 3.0
"""Vehicles that leave the exit faster than this make space in time, unless one ahead of them stands."""

QUEUE_GAP_M = 5.0
"""Gap between vehicles in a queue."""

GENTLE_M = 60.0
"""In bends of a larger radius long vehicles hardly swing out: they count as straight."""

COMMIT_M = 10.0
"""A vehicle that must give way can still stop if it is farther than this from the line."""

FIRST, USUAL, YIELDS = 1, 0, -1
"""Roles of movements. FIRST waits only for vehicles that are on their way already. USUAL goes in the order of asking.
YIELDS loses its grant to FIRST, up to `COMMIT_M`."""


def roles(clear_m: Floats, has_priority: Sequence[bool]) -> Ints:
    """Return the roles (K,) of movements, from their clearances (K, K) and which of them have priority."""
    priority = np.array(has_priority, dtype=np.bool_)
    yields = (np.isfinite(clear_m) & priority).any(axis=1)
    return np.where(priority, FIRST, np.where(yields, YIELDS, USUAL)).astype(np.int64)


def clearances(network: RoadNetwork, movements: Sequence[Road], clearance_m: float = CLEARANCE_M) -> Floats:
    """Return (K, K) m: how far along movement b its last place near movement a is.

    Infinite below zero where they do not come near, or start at the same line.
    """
    lanes = [network.get_lane((*road, 0)) for road in movements]
    if not lanes:
        return np.zeros((0, 0))
    lines = [_middle_line(lane) for lane in lanes]
    first = np.cumsum([0, *(len(line) for line in lines)])
    nodes: dict[str, int] = {}
    origin = np.array([nodes.setdefault(start, len(nodes)) for start, _ in movements])
    gentle = np.array([not isinstance(lane, CircularLane) or lane.radius > GENTLE_M for lane in lanes])
    near_m = np.where(gentle[:, None] & gentle, clearance_m, CLEARANCE_M)
    last = _last_near(np.concatenate(lines), first, origin, near_m)
    counts, length_m = np.diff(first), np.array([lane.length for lane in lanes])
    clear_m: Floats = np.where(last >= 0, last / (counts - 1) * length_m, -np.inf)
    return clear_m


@njit(cache=True, nogil=True)
def _last_near(points: Floats, first: Ints, origin: Ints, near_m: Floats) -> Ints:
    """Return (K, K) the number of line b's last point that is near line a, -1: none, or both start at one node.

    Args:
        points: (P, 2) m of all lines.
        first: (K + 1,) first point of each line, and P.
        origin: (K,) node that each starts at.
        near_m: (K, K) distance below which lines are near.
    """
    count = len(origin)
    last = np.full((count, count), -1)
    low, high = np.empty((count, 2)), np.empty((count, 2))
    for k in range(count):
        for axis in range(2):
            own = points[first[k] : first[k + 1], axis]
            low[k, axis], high[k, axis] = own.min(), own.max()
    for a in range(count):
        for b in range(count):
            reach = near_m[a, b]
            apart = (low[a] - high[b] > reach).any() or (low[b] - high[a] > reach).any()
            if not apart and origin[a] != origin[b]:
                last[a, b] = _last_of(points[first[a] : first[a + 1]], points[first[b] : first[b + 1]], reach)
    return last


@njit(cache=True, nogil=True)
def _last_of(line: Floats, other: Floats, near_m: float) -> int:
    """Return the number of the last point of another line (M, 2) that is near one (N, 2), -1: none."""
    for k in range(len(other) - 1, -1, -1):
        for i in range(len(line)):
            dx, dy = line[i, 0] - other[k, 0], line[i, 1] - other[k, 1]
            if math.sqrt(dx * dx + dy * dy) < near_m:
                return k
    return -1


def _middle_line(lane: Lane) -> Floats:
    """Return points (K, 2) about half a metre apart."""
    return lane.positions(np.linspace(0.0, lane.length, int(2 * lane.length) + 2), 0.0)
