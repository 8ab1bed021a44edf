"""Right of way where roads meet: constants, conflicts and roles of movements, for either engine.

A movement is a road over a junction, from stop line to exit. Vehicles ask for theirs; the first to ask goes first, and
a vehicle that would cross one that waits longer waits, too, so none starves.

A vehicle bars a movement only until its tail is past the place where the two come close. A vehicle that waits for space
behind the junction, or in line behind such a one, does not bar those at the head of their lines: queues around a block
would wait for each other for ever. Nor does one with priority, in line behind one that gives way. A vehicle that stands
at the head of a line turns elsewhere if the exit that it wanted is full.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import Lane, Road, RoadNetwork, StraightLane

REQUEST_M = 32.0
"""Distance to the stop line from which on a vehicle asks."""

EXIT_SPACE_M = 9.0
"""Free length needed behind the last vehicle on the exit: no vehicle waits on the junction."""

EXIT_HALF_WIDTH_M = 2.5

SLOW_M_S = 3.0
"""Vehicles that leave the exit faster than this make space in time, unless one ahead of them stands."""

QUEUE_GAP_M = 5.0
"""Gap between vehicles in a queue."""

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
    lines = [_middle_line(lane) for lane in lanes]
    clear_m = np.full((len(movements), len(movements)), -np.inf)
    for a in range(len(movements)):
        for b in range(len(movements)):
            gap_m = np.linalg.norm(lines[a][:, None] - lines[b], axis=2).min(axis=0)
            straight = isinstance(lanes[a], StraightLane) and isinstance(lanes[b], StraightLane)
            near = np.flatnonzero(gap_m < (clearance_m if straight else CLEARANCE_M))
            if len(near) and movements[a][0] != movements[b][0]:
                clear_m[a, b] = near[-1] / (len(lines[b]) - 1) * lanes[b].length
    return clear_m


def _middle_line(lane: Lane) -> Floats:
    """Return points (K, 2) about half a metre apart."""
    return np.array([lane.position(s, 0.0) for s in np.linspace(0.0, lane.length, int(2 * lane.length) + 2)])
