"""Roads of a place that cross or join."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.outlines import lines_cross
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.places.polyline import BEND_M, LONGEST_M, PolylineLane
from coopsim.world.places.road_network import Lane, Road, RoadNetwork

BESIDE_M = 4.2
"""Two lanes with narrow bends conflict where they lie nearer than that: long vehicles need both."""

CHORD_M = 1.0
"""Longest chord of an arc: 2 cm from it at a radius of 6 m."""


def conflicting_roads(network: RoadNetwork) -> tuple[Road, ...]:
    """Return roads whose middle line crosses another's, ends where another ends, or turns beside it.

    They are in the network's order.

    Roads that follow each other, or part at one node, do not conflict there. Of each road its first lane counts.
    """
    lanes = {index[:2]: lane for index, lane in network.lanes.items() if index[2] == 0}
    if not lanes:
        return ()
    lines = [middle_line(lane) for lane in lanes.values()]
    first = np.cumsum([0, *(len(line) for line in lines)])
    nodes: dict[str, int] = {}
    ends = np.array([[nodes.setdefault(node, len(nodes)) for node in road] for road in lanes])
    bends = np.array([_is_bend(lane) for lane in lanes.values()])
    found = _in_conflict(np.concatenate(lines), first, ends, bends)
    return tuple(road for road, conflicts in zip(lanes, found, strict=True) if conflicts)


def _is_bend(lane: Lane) -> bool:
    return isinstance(lane, PolylineLane) and lane.tightest_m < BEND_M and lane.length < LONGEST_M


def middle_line(lane: Lane) -> Floats:
    """Return the corners (K, 2) m of a line that follows the lane's middle."""
    return lane.positions(lane.stations(CHORD_M), 0.0)


@njit(cache=True, nogil=True)
def _in_conflict(points: Floats, first: Ints, ends: Ints, bends: Mask) -> Mask:
    """Return the mask (K,) of lines that conflict with another.

    `points` (P, 2) m are those of all lines, `first` (K + 1,) the first one of each line, and P; `ends` (K, 2) the
    nodes that each leads from and to, and `bends` (K,) which ones are curved lanes with a narrow bend.
    """
    count = len(ends)
    found = np.zeros(count, np.bool_)
    box = np.empty((count, 4))
    for k in range(count):
        line = points[first[k] : first[k + 1]]
        box[k] = line[:, 0].min(), line[:, 1].min(), line[:, 0].max(), line[:, 1].max()
    for a in range(count):
        for b in range(a + 1, count):
            if ends[a, 0] == ends[b, 0] or ends[a, 1] == ends[b, 0] or ends[b, 1] == ends[a, 0]:
                continue
            if ends[a, 1] == ends[b, 1] or (
                _touch(box[a], box[b]) and lines_cross(points[first[a] : first[a + 1]], points[first[b] : first[b + 1]])
            ):
                found[a] = found[b] = True
            elif bends[a] and bends[b] and _touch(box[a], box[b]):
                beside = _lie_near(points[first[a] : first[a + 1]], points[first[b] : first[b + 1]])
                found[a], found[b] = found[a] or beside, found[b] or beside
    return found


@njit(cache=True, nogil=True)
def _lie_near(a: Floats, b: Floats) -> bool:
    """Return whether a point of a polyline (N, 2) lies near one of another (M, 2)."""
    for i in range(len(a)):
        for k in range(len(b)):
            dx, dy = a[i, 0] - b[k, 0], a[i, 1] - b[k, 1]
            if dx * dx + dy * dy < BESIDE_M * BESIDE_M:
                return True
    return False


@njit(cache=True, nogil=True)
def _touch(a: Floats, b: Floats) -> bool:
    """Return whether two upright rectangles (4,) - low x, low y, high x, high y - meet."""
    return bool(a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3])
