"""Ground that long vehicles sweep on curved movements, and movements that conflict for them alone.

Where lanes are curved, buses and trucks lead their front axle along the lane: their rear cuts inside, and their front
swings out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import Lane, Road, RoadNetwork

_STEP_M = 1.0
_BEYOND = 13  # points before a movement and behind it: the longest vehicle reaches so far
_GAP_M = 0.3  # to keep between two
_SAME_WAY = 0.7  # cosine
_CAR_M, _WAITING_M = 1.0, 7.0  # half the width of a waiting car, and from its front to its line
_BUS = np.array([6.15, 3.1, 3.1, 1.3])
"""From the point that is led along the lane to the rear axle, from there to the rear, from the point to the front, and
half the width, m: of the longest bus, 12.3 m."""


def clearances_of_long(network: RoadNetwork, movements: Sequence[Road], clear_m: Floats) -> tuple[Floats, Floats]:
    """Return clearances (K, K) m where one of the two vehicles is long, from those of cars (see `clearances`).

    They differ where one of the two movements is curved (a `PolylineLane`), as those of maps are. Return also how far
    back from the line of each (K,) m vehicles have to wait, out of what others sweep.
    """
    lanes = [network.get_lane((*road, 0)) for road in movements]
    curved = np.array([isinstance(lane, PolylineLane) for lane in lanes], np.bool_)
    if not curved.any():
        return clear_m, np.zeros(len(lanes))
    into, onward = ({index[end]: lane for index, lane in network.lanes.items()} for end in (1, 0))
    lines = [
        _extended(lane, into.get(road[0]), onward.get(road[1])) for lane, road in zip(lanes, movements, strict=True)
    ]
    first = np.cumsum([0, *(len(line) for line in lines)])
    nodes: dict[str, int] = {}
    ends = np.array([[nodes.setdefault(node, len(nodes)) for node in road] for road in movements])
    last, back_m = _last_met(np.concatenate(lines), first, ends, curved)
    counts, length_m = np.diff(first), np.array([lane.length for lane in lanes])
    along_m = (last - _BEYOND) / (counts - 1 - 2 * _BEYOND) * length_m
    return np.where(last >= 0, np.maximum(clear_m, along_m), clear_m), back_m


def _extended(lane: Lane, before: Lane | None, after: Lane | None) -> Floats:
    """Return points (K, 2) about 1 m apart on a lane's middle, and straight on in the lanes before it and behind it."""
    line = lane.positions(np.linspace(0.0, lane.length, int(lane.length / _STEP_M) + 2), 0.0)
    start_rad = before.heading_at(before.length) if before else lane.heading_at(0.0)
    end_rad = after.heading_at(0.0) if after else lane.heading_at(lane.length)
    back, on = (_STEP_M * np.array([exact.cos(each), exact.sin(each)]) for each in (start_rad, end_rad))
    beyond = np.arange(1, _BEYOND + 1)[:, None]
    return np.concatenate([line[0] - beyond[::-1] * back, line, line[-1] + beyond * on])


@njit(cache=True, nogil=True)
def _last_met(points: Floats, first: Ints, ends: Ints, curved: Mask) -> tuple[Ints, Floats]:
    """Return (K, K) the number of line b's last point that what is swept on it and on line a meet at, -1: none.

    Return also how far back (K,) m vehicles have to wait.

    `points` (P, 2) m are those of all lines, `first` (K + 1,) the first one of each line, and P, `ends` (K, 2) the
    nodes that lines lead from and to, and `curved` (K,) whether they bend.
    """
    count = len(ends)
    last, box, aside = np.full((count, count), -1), np.empty((count, 4)), np.zeros((len(points), 2))
    back_m = np.zeros(count)
    for k in range(count):
        line = points[first[k] : first[k + 1]]
        _sweep(line, aside[first[k] : first[k + 1]])
        reach = aside[first[k] : first[k + 1]].max() + _GAP_M
        box[k, 0], box[k, 1] = line[:, 0].min() - reach, line[:, 1].min() - reach
        box[k, 2], box[k, 3] = line[:, 0].max() + reach, line[:, 1].max() + reach
    for a in range(count):
        for b in range(count):
            apart = box[a, 0] > box[b, 2] or box[b, 0] > box[a, 2] or box[a, 1] > box[b, 3] or box[b, 1] > box[a, 3]
            if not apart and ends[a, 0] != ends[b, 0] and (curved[a] or curved[b]):
                one, other = slice(first[a], first[a + 1]), slice(first[b], first[b + 1])
                last[a, b] = _last_of(points[one], aside[one], points[other], aside[other])
                back_m[b] = max(back_m[b], _back_m(points[one], aside[one], points[other]))
    return last, back_m


@njit(cache=True, nogil=True)
def _sweep(line: Floats, aside: Floats) -> None:
    """Write what the longest bus sweeps to the left and right (K, 2) m of a line (K, 2)."""
    wheelbase_m, behind_m, ahead_m, half_m = _BUS
    rear_x = line[0, 0] - wheelbase_m * (line[1, 0] - line[0, 0]) / _STEP_M
    rear_y = line[0, 1] - wheelbase_m * (line[1, 1] - line[0, 1]) / _STEP_M
    steps = int(wheelbase_m + behind_m + ahead_m) + 1
    for k in range(len(line)):
        dx, dy = line[k, 0] - rear_x, line[k, 1] - rear_y
        length_m = exact.hypot(dx, dy)
        ux, uy = dx / length_m, dy / length_m
        rear_x, rear_y = line[k, 0] - wheelbase_m * ux, line[k, 1] - wheelbase_m * uy
        for place in range(steps + 1):
            along_m = -behind_m + place / steps * (wheelbase_m + behind_m + ahead_m)
            x, y = rear_x + along_m * ux, rear_y + along_m * uy
            near, least = -1, np.inf
            for i in range(max(k - _BEYOND, 0), min(k + _BEYOND, len(line))):
                apart = (line[i, 0] - x) ** 2 + (line[i, 1] - y) ** 2
                if apart < least:
                    near, least = i, apart
            tx, ty = _direction(line, near)
            left_m = tx * (y - line[near, 1]) - ty * (x - line[near, 0])
            across_m = half_m / max(abs(ux * tx + uy * ty), 0.5)
            aside[near, 0] = max(aside[near, 0], left_m + across_m)
            aside[near, 1] = max(aside[near, 1], across_m - left_m)


@njit(cache=True, nogil=True)
def _direction(line: Floats, k: int) -> tuple[float, float]:
    """Return the direction of a line (K, 2) at a point, of length 1."""
    before, after = max(k - 1, 0), min(k + 1, len(line) - 1)
    dx, dy = line[after, 0] - line[before, 0], line[after, 1] - line[before, 1]
    length_m = exact.hypot(dx, dy)
    return dx / length_m, dy / length_m


@njit(cache=True, nogil=True)
def _last_of(line: Floats, aside: Floats, other: Floats, other_aside: Floats) -> int:
    """Return the number of another line's last point (M, 2) whose sweep meets that of one (N, 2), -1: none.

    Before and behind a movement lanes that lead the same way are one, or side by side.
    """
    for k in range(len(other) - _BEYOND - 1, -1, -1):
        bx, by = _direction(other, k)
        for i in range(len(line)):
            dx, dy = other[k, 0] - line[i, 0], other[k, 1] - line[i, 1]
            if dx * dx + dy * dy > 144.0:
                continue
            ax, ay = _direction(line, i)
            outside = k < _BEYOND or i < _BEYOND or i >= len(line) - _BEYOND
            if outside and ax * bx + ay * by > _SAME_WAY:
                continue
            reach_m = _GAP_M + aside[i, 0 if ax * dy - ay * dx > 0 else 1]
            reach_m += other_aside[k, 0 if by * dx - bx * dy > 0 else 1]
            if dx * dx + dy * dy < reach_m * reach_m:
                return k
    return -1


@njit(cache=True, nogil=True)
def _back_m(line: Floats, aside: Floats, other: Floats) -> float:
    """Return how far back a car has to wait before another line (M, 2), out of what is swept on one (N, 2), m."""
    for k in range(_BEYOND - int(_WAITING_M)):
        bx, by = _direction(other, k)
        for i in range(len(line)):
            ax, ay = _direction(line, i)
            dx, dy = other[k, 0] - line[i, 0], other[k, 1] - line[i, 1]
            reach_m = _GAP_M + _CAR_M + aside[i, 0 if ax * dy - ay * dx > 0 else 1]
            if ax * bx + ay * by < _SAME_WAY and dx * dx + dy * dy < reach_m * reach_m:
                return _BEYOND - k - _WAITING_M
    return 0.0
