"""Movements over junctions: where they conflict, and which give way to which."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.types.driving import NO_LIGHT
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import Lane, Road, RoadNetwork
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.swept import clearances_of_long

GENTLE_M = 60.0
"""In bends of a larger radius long vehicles hardly swing out: they count as straight."""

_SAME_WAY = 0.5  # square of the cosine of an angle of 45 degrees
_OVER_M, _BODIES_M = 0.6, 2.4  # by which neighbouring lanes may overlap; between the middles of vehicles side by side

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
    gentle = np.array([lane.tightest_m > GENTLE_M for lane in lanes])
    straight = gentle[:, None] & gentle
    near_m = np.where(straight, clearance_m, CLEARANCE_M)
    beside_m = _beside(lanes, near_m)
    # Narrow lanes of opposite directions lie side by side, too.
    last = _last_near(np.concatenate(lines), first, origin, np.where(straight, beside_m, near_m), beside_m)
    counts, length_m = np.diff(first), np.array([lane.length for lane in lanes])
    clear_m: Floats = np.where(last >= 0, last / (counts - 1) * length_m, -np.inf)
    return clear_m


@njit(cache=True, nogil=True)
def _last_near(points: Floats, first: Ints, origin: Ints, near_m: Floats, beside_m: Floats) -> Ints:
    """Return (K, K) the number of line b's last point that is near line a, -1: none, or both start at one node.

    `points` (P, 2) m are those of all lines, `first` (K + 1,) the first one of each line, and P, `origin` (K,) the
    nodes that lines start at, `near_m` (K, K) the distances below which they are near, and `beside_m` (K, K) those
    where they lead the same way.
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
                line, other = points[first[a] : first[a + 1]], points[first[b] : first[b + 1]]
                last[a, b] = _last_of(line, other, reach, beside_m[a, b])
    return last


@njit(cache=True, nogil=True)
def _last_of(line: Floats, other: Floats, near_m: float, beside_m: float) -> int:
    """Return the number of the last point of another line (M, 2) that is near one (N, 2), -1: none."""
    for k in range(len(other) - 1, -1, -1):
        for i in range(len(line)):
            dx, dy = line[i, 0] - other[k, 0], line[i, 1] - other[k, 1]
            apart_m = math.sqrt(dx * dx + dy * dy)
            if apart_m < beside_m or (apart_m < near_m and not _same_way(line, i, other, k)):
                return k
    return -1


@njit(cache=True, nogil=True)
def _same_way(line: Floats, i: int, other: Floats, k: int) -> bool:
    """Return whether two lines (N, 2) and (M, 2) lead in nearly the same direction at their points."""
    i, k = min(i, len(line) - 2), min(k, len(other) - 2)
    ax, ay = line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1]
    bx, by = other[k + 1, 0] - other[k, 0], other[k + 1, 1] - other[k, 1]
    ahead = ax * bx + ay * by
    return bool(ahead > 0 and ahead * ahead > _SAME_WAY * (ax * ax + ay * ay) * (bx * bx + by * by))


def _beside(lanes: Sequence[Lane], near_m: Floats) -> Floats:
    """Return the distances (K, K) m below which lanes that lead the same way conflict.

    Neighbouring curved lanes, which may be narrow, do not, as they turn off side by side.
    """
    width_m = np.array([lane.width for lane in lanes])
    curved = np.array([isinstance(lane, PolylineLane) for lane in lanes])
    apart_m = np.maximum((width_m[:, None] + width_m) / 2 - _OVER_M, _BODIES_M)
    return np.where(curved[:, None] | curved, np.minimum(near_m, apart_m), near_m)


def _middle_line(lane: Lane) -> Floats:
    """Return points (K, 2) about half a metre apart."""
    return lane.positions(np.linspace(0.0, lane.length, int(2 * lane.length) + 2), 0.0)


class Movements(NamedTuple):
    """The K movements of a place, as they are now.

    Attributes:
        of_road: (R,) number of the movement that a road is, -1: none.
        road: (K,) the road of each.
        clear_m: (K, K) m, see `clearances`.
        long_clear_m: (K, K) m, the same where one of the two vehicles is long.
        back_m: (K,) m, how far back from their lines vehicles have to wait.
        role: (K,) `FIRST`, `USUAL` or `YIELDS`.
        exit: (K,) node that a movement leads to.
        yields: (K, K) whether the first gives way to the second.
        closed: (K,) whether a light is red or yellow.
        clears: (K,) whether even vehicles with priority wait for space behind the junction.
        braking_m_s2: braking at which fast vehicles can stop at lines, which they ask for from the farther off;
            infinite: all ask at `REQUEST_M`.
        light: (K,) `NO_LIGHT`, `GREEN`, `YELLOW` or `RED`.
    """

    of_road: Ints
    road: Ints
    clear_m: Floats
    long_clear_m: Floats
    back_m: Floats
    role: Ints
    exit: Ints
    yields: Mask
    closed: Mask
    clears: Mask
    braking_m_s2: float
    light: Ints


BRAKING_M_S2 = 3.1
"""Braking before lines where a place says who yields, or has lights."""


def movements_of(
    network: NumberedNetwork,
    roads: Sequence[Road],
    priority: Sequence[Road],
    clearance_m: float,
    given: Mapping[Road, Sequence[Road]] | None = None,
    *,
    lights: bool = False,
) -> Movements:
    """Return the movements over some roads, all of them open.

    Args:
        network: all roads.
        roads: the movements.
        priority: movements to which others give way.
        clearance_m: see `Layout`.
        given: movements to which one gives way, by that one, in place of the rule by `priority`.
        lights: whether there are lights.
    """
    numbers = [network.road_number[road] for road in roads]
    of_road = np.full(len(network.road_number), -1, dtype=np.int64)
    of_road[numbers] = np.arange(len(numbers))
    clear_m = clearances(network.source, roads, clearance_m)
    exits = network.arrays.roads["end"][numbers].astype(np.int64)
    first = np.array([road in priority for road in roads], dtype=np.bool_)
    role, yields = roles(clear_m, first.tolist()), np.isfinite(clear_m) & first & ~first[:, None]
    for road, others in (given or {}).items():
        k = roads.index(road)
        yields[k] = np.isfinite(clear_m[k]) & np.isin(np.arange(len(roads)), [roads.index(other) for other in others])
    if given:
        role = np.where(yields.any(axis=1), YIELDS, np.where(first | yields.any(axis=0), FIRST, USUAL))
    none = np.zeros(len(roads), np.bool_)
    braking_m_s2 = BRAKING_M_S2 if given or lights else np.inf
    long_clear_m, back_m = clearances_of_long(network.source, roads, clear_m)
    return Movements(
        of_road,
        np.array(numbers, dtype=np.int64),
        clear_m,
        long_clear_m,
        back_m,
        role,
        exits,
        yields,
        none,
        none,
        braking_m_s2,
        np.full(len(roads), NO_LIGHT),
    )
