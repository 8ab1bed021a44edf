"""Lines along which furniture stands: the right edges of streets, people's ways, fronts of buildings."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.furniture.free_ground import distance_to
from coopsim.world.furniture.kept_free import lines_of, middle_of
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import CircularLane, Lane, StraightLane

_TIGHT_M = 25.0  # radius of bends at turning loops and junctions, beside which nothing is lined up
_FRONT_M = (2.5, 9.0)  # from a building's front to people's way
_SHORTEST_FRONT_M = 8.0


class Side(NamedTuple):
    """A line through K + 1 points, to the right of which furniture may stand.

    Attributes:
        points: (K + 1, 2) m.
        starts_m: (K + 1,) distances of the points along the line.
        heading_rad: (K,) of the pieces between them.
        edge_m: (K,) from the line to where offsets begin.
    """

    points: Floats
    starts_m: Floats
    heading_rad: Floats
    edge_m: Floats

    @property
    def length_m(self) -> float:
        """The length of the line."""
        return float(self.starts_m[-1])

    def stands(self, along_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (N, 2) m on the edge, unit vectors outward (N, 2), and headings (N,) rad."""
        which = np.clip(np.searchsorted(self.starts_m, along_m, "right") - 1, 0, len(self.edge_m) - 1)
        heading = self.heading_rad[which]
        cos, sin = np.cos(heading), np.sin(heading)
        ahead, outward = np.column_stack([cos, sin]), np.column_stack([sin, -cos])
        middle = self.points[which] + (along_m - self.starts_m[which])[:, None] * ahead
        return middle + self.edge_m[which][:, None] * outward, outward, heading


def _side(points: Floats, edge_m: Floats) -> Side:
    """Make a side of a line through points (K + 1, 2) m, with the distances (K,) of its edge."""
    along = np.diff(points, axis=0)
    starts = np.concatenate([[0.0], np.cumsum(np.hypot(along[:, 0], along[:, 1]))])
    return Side(points, starts, np.arctan2(along[:, 1], along[:, 0]), edge_m)


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
        lines = [middle_of(_within(rightmost[road], area)) for road in chain]
        edge = np.repeat([rightmost[road].width / 2 for road in chain], [len(line) - 1 for line in lines])
        sides.append(_side(np.vstack([*(line[:-1] for line in lines), lines[-1][-1:]]), edge))
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


def _within(lane: Lane, area: Floats) -> Lane:
    """Return the part of a lane that is in an area; all of it if it is bent or not very long."""
    if not isinstance(lane, StraightLane) or lane.length < float(np.abs(area[1] - area[0]).max()):
        return lane
    along = np.clip([lane.local_coordinates(corner)[0] for corner in area], 0.0, lane.length)
    start, end = float(along.min()), max(float(along.max()), float(along.min()) + 1.0)
    return StraightLane(lane.position(start, 0.0), lane.position(end, 0.0), lane.width)


def way_sides(layout: Layout) -> list[Side]:
    """Return both sides of people's ways; furniture stands on those away from the road."""
    if layout.footways is None:
        return []
    ways = lines_of(layout.footways, crossing=False)
    return [_side(line, np.zeros(1)) for way in ways for line in (way, way[::-1])]


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
