"""Lines along which furniture stands: the right edges of streets, people's ways, fronts of buildings."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.furniture.free_ground import distance_to
from coopsim.world.furniture.kept_free import lines_of
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import CircularLane, Lane, StraightLane

_TIGHT_M = 25.0  # radius of bends at turning loops and junctions, beside which nothing is lined up
_FRONT_M = (2.5, 9.0)  # from a building's front to people's way
_SHORTEST_FRONT_M = 8.0


class Side(NamedTuple):
    """A line, cut into K straight or bent pieces, and the side of it where furniture may stand.

    Attributes:
        lanes: the pieces.
        starts_m: (K + 1,) where they begin along the line.
        edge_m: (K,) from the middle of the pieces to where offsets begin, to the right.
    """

    lanes: tuple[Lane, ...]
    starts_m: Floats
    edge_m: Floats

    @property
    def length_m(self) -> float:
        """The length of the line."""
        return float(self.starts_m[-1])

    def stands(self, along_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (N, 2) m on the edge, unit vectors outward (N, 2), and headings (N,) rad."""
        which = np.clip(np.searchsorted(self.starts_m, along_m, "right") - 1, 0, len(self.lanes) - 1)
        rest = along_m - self.starts_m[which]
        middle, heading = np.empty((len(along_m), 2)), np.empty(len(along_m))
        for k in np.unique(which).tolist():
            mine, lane = which == k, self.lanes[k]
            if isinstance(lane, StraightLane):
                middle[mine], heading[mine] = lane.start + rest[mine, None] * lane.direction, lane.heading
            else:
                middle[mine] = [lane.position(s, 0.0) for s in rest[mine].tolist()]
                heading[mine] = [lane.heading_at(s) for s in rest[mine].tolist()]
        outward = np.column_stack([np.sin(heading), -np.cos(heading)])
        return middle + self.edge_m[which][:, None] * outward, outward, heading


def street_sides(layout: Layout, area: Floats) -> list[Side]:
    """Return the right edges of all streets within an area, but not of junctions and turning loops."""
    rightmost: dict[tuple[str, str], Lane] = {}
    for (start, end, _), lane in layout.network.lanes.items():
        bend = isinstance(lane, CircularLane) and lane.radius < _TIGHT_M
        if (start, end) not in layout.movements and not bend:
            rightmost[start, end] = lane  # lanes of a road come from the left to the right
    following, before = defaultdict[str, list[tuple[str, str]]](list), defaultdict[str, int](int)
    for road in rightmost:
        following[road[0]].append(road)
        before[road[1]] += 1
    chained = {road: _next(road, rightmost, following, before) for road in rightmost}
    inner = {after for after in chained.values() if after is not None}
    sides = []
    for first in (road for road in rightmost if road not in inner):
        chain, after = [first], chained[first]
        while after is not None and after not in chain:
            chain.append(after)
            after = chained[after]
        lanes = tuple(_within(rightmost[road], area) for road in chain)
        starts = np.cumsum([0.0, *(lane.length for lane in lanes)])
        sides.append(Side(lanes, starts, np.array([lane.width / 2 for lane in lanes])))
    return sides


def _next(
    road: tuple[str, str],
    lanes: dict[tuple[str, str], Lane],
    following: dict[str, list[tuple[str, str]]],
    before: dict[str, int],
) -> tuple[str, str] | None:
    """Return the road that goes straight on; None where roads join or part."""
    onward = following[road[1]]
    if len(onward) != 1 or before[road[1]] != 1:
        return None
    here, there = lanes[road], lanes[onward[0]]
    return onward[0] if abs(wrap_angle(there.heading_at(0.0) - here.heading_at(here.length))) < 0.3 else None


class _Stretch(Lane):
    """A part of a lane."""

    def __init__(self, lane: Lane, start_m: float, end_m: float) -> None:
        super().__init__(lane.width, lane.speed_limit, forbidden=False)
        self._lane, self._start_m, self.length = lane, start_m, end_m - start_m

    def position(self, along_m: float, aside_m: float) -> Floats:
        return self._lane.position(self._start_m + along_m, aside_m)

    def heading_at(self, along_m: float) -> float:
        return self._lane.heading_at(self._start_m + along_m)

    def local_coordinates(self, position: Floats) -> tuple[float, float]:
        along_m, aside_m = self._lane.local_coordinates(position)
        return along_m - self._start_m, aside_m


def _within(lane: Lane, area: Floats) -> Lane:
    """Return the part of a lane that is in an area; all of it if it is not very long."""
    reach = float(np.abs(area[1] - area[0]).max())
    if lane.length < reach:
        return lane
    along = np.sort([lane.local_coordinates(corner)[0] for corner in (area[0], area[1])])
    start, end = np.clip(along, 0.0, lane.length).tolist()
    return _Stretch(lane, start, max(end, start + 1.0))


def way_sides(layout: Layout) -> list[Side]:
    """Return both sides of people's ways; furniture stands on those away from the road."""
    if layout.footways is None:
        return []
    sides = []
    for a, b in lines_of(layout.footways, crossing=False):
        for start, end in ((a, b), (b, a)):
            lane = StraightLane(start, end, width=0.0)
            sides.append(Side((lane,), np.array([0.0, lane.length]), np.zeros(1)))
    return sides


def fronts(layout: Layout) -> list[tuple[Floats, Floats]]:
    """Return ends (2, 2) m and outward unit vectors (2,) of buildings' sides along people's ways."""
    if layout.footways is None:
        return []
    ways = np.array(lines_of(layout.footways, crossing=False)).reshape(-1, 2, 2)
    found = []
    for outline in layout.road_map.buildings:
        following = np.roll(outline, -1, axis=0)
        twice_area = float((outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1]).sum())
        for start, end in zip(outline, following, strict=True):
            along = end - start
            length = float(np.hypot(*along))
            if length < _SHORTEST_FRONT_M:
                continue
            out = np.array([along[1], -along[0]]) / length * np.sign(twice_area)
            before = (start + end) / 2 + out * np.mean(_FRONT_M)
            away = min(distance_to(before, way, 0, 2) for way in ways)
            if away < (_FRONT_M[1] - _FRONT_M[0]) / 2:
                found.append((np.array([start, end]), out))
    return found
