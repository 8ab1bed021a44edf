"""Lines along which furniture stands: outer edges of streets, people's ways, fronts of buildings."""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.arrays import numbered
from coopsim.types import Ints, Mask
from coopsim.world.furniture.free_ground import (
    GROUND,
    Obstacles,
    are_free,
    lines_of,
    make_obstacles,
    middle_of,
)
from coopsim.world.places.layout import Footways, Layout
from coopsim.world.places.road_network import Lane, StraightLane

_TIGHT_M = 25.0  # radius of bends at turning loops and junctions, beside which nothing is lined up
_STRAIGHT_ON_RAD = 0.5  # largest turn within one line
_FRONT_M = (2.5, 9.0)  # from a building's front to people's way
_SHORTEST_FRONT_M = 8.0
_SAMPLE_M = 4.0
_LOTS_M = 50.0


class Sides(NamedTuple):
    """S lines, one after the other, with M straight pieces in all; furniture may stand to one side of each.

    Distances are counted from the beginning of the first line, through all.

    Attributes:
        points: (M, 2) m, beginnings of the pieces.
        starts_m: (M,) their distances.
        heading_rad: (M,) directions of the pieces.
        edge_m: (M,) distances from the line to the edge where offsets begin.
        first_m: (S + 1,) distances of the beginnings of lines, and the length of all.
        side: side of the lines on which furniture stands, 1: left, -1: right.
    """

    points: Floats
    starts_m: Floats
    heading_rad: Floats
    edge_m: Floats
    first_m: Floats
    side: int

    @property
    def length_m(self) -> Floats:
        """Lengths (S,) of the lines."""
        return np.diff(self.first_m)

    def stands(self, along_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (N, 2) m on the edge, unit vectors outward (N, 2), and headings (N,) rad at distances (N,)."""
        which = np.clip(np.searchsorted(self.starts_m, along_m, "right") - 1, 0, len(self.edge_m) - 1)
        heading = self.heading_rad[which]
        cos, sin = exact.cos(heading), exact.sin(heading)
        ahead, outward = np.column_stack([cos, sin]), self.side * np.column_stack([-sin, cos])
        middle = self.points[which] + (along_m - self.starts_m[which])[:, None] * ahead
        return middle + self.edge_m[which][:, None] * outward, outward, heading

    def grid(self, step_m: float) -> tuple[Floats, Ints]:
        """Return distances (N,) of evenly spaced places on all lines, and the numbers (N,) of these."""
        counts = np.maximum(self.length_m // step_m, 1).astype(np.int64)
        side, place = numbered(counts)
        return self.first_m[side] + (place + 0.5) / counts[side] * self.length_m[side], side


def _sides(lines: list[tuple[Floats, Floats]], side: int) -> Sides:
    """Join lines, each given by points (K + 1, 2) m and distances (K,) of the edge on a side."""
    along = [np.diff(points, axis=0) for points, _ in lines]
    every = np.concatenate([np.zeros((0, 2)), *along])
    lengths = exact.hypot(every[:, 0], every[:, 1])
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    ends = np.cumsum([0, *(len(each) for each in along)])
    return Sides(
        np.concatenate([np.zeros((0, 2)), *(points[:-1] for points, _ in lines)]),
        starts[:-1],
        exact.arctan2(every[:, 1], every[:, 0]),
        np.concatenate([np.zeros(0), *(edge for _, edge in lines)]),
        starts[ends],
        side,
    )


def street_sides(layout: Layout, area: Floats, lanes: Obstacles) -> Sides:
    """Return the outer edges of streets within an area, but not of junctions, turning loops, and inner lanes."""
    outermost: dict[tuple[str, str], Lane] = {}
    every = list(layout.network.lanes.items())[:: -layout.outer_side]  # of a road from the inner lane to the outer one
    for (start, end, _), lane in every:
        if (start, end) not in layout.movements and lane.tightest_m >= _TIGHT_M:
            outermost[start, end] = lane
    lines = []
    for chain in _chains(outermost):
        middles = [middle_of(_within(outermost[road], area)) for road in chain]
        edge = np.repeat([outermost[road].width / 2 for road in chain], [len(line) - 1 for line in middles])
        lines.append((np.vstack([*(line[:-1] for line in middles), middles[-1][-1:]]), edge))
    return _outer(lines, (0.3,), lanes, layout.outer_side)


def way_sides(layout: Layout, lanes: Obstacles) -> Sides:
    """Return the sides of people's ways on which there is no road."""
    if layout.footways is None:
        return _sides([], layout.outer_side)
    ways = [part for line in _way_chains(layout.footways) for part in _in_parts(line)]
    lines = [(line, np.zeros(len(line) - 1)) for way in ways for line in (way, way[::-1])]
    return _outer(lines, (1.5, 2.5, 3.5), lanes, layout.outer_side)


def fronts(layout: Layout) -> tuple[Floats, Floats]:
    """Return ends (N, 2, 2) m and outward unit vectors (N, 2) of buildings' sides along people's ways."""
    if layout.footways is None or not layout.road_map.buildings:
        return np.zeros((0, 2, 2)), np.zeros((0, 2))
    ends = np.concatenate(
        [np.stack([outline, np.roll(outline, -1, axis=0)], axis=1) for outline in layout.road_map.buildings]
    )
    along = ends[:, 1] - ends[:, 0]
    length = exact.hypot(along[:, 0], along[:, 1])
    out = np.column_stack([along[:, 1], -along[:, 0]]) / np.maximum(length, 1e-9)[:, None]  # counter-clockwise
    before = ends.mean(axis=1) + out * np.mean(_FRONT_M)
    ways = lines_of(layout.footways, crossing=False)
    reach = (_FRONT_M[1] - _FRONT_M[0]) / 2
    area = np.stack([before.min(axis=0), before.max(axis=0)])
    near = ~are_free(before, 0.0, GROUND, make_obstacles(ways, [reach] * len(ways), [GROUND] * len(ways), area))
    chosen = near & (length > _SHORTEST_FRONT_M)
    return ends[chosen], out[chosen]


def _outer(lines: list[tuple[Floats, Floats]], outward_m: tuple[float, ...], lanes: Obstacles, outward: int) -> Sides:
    """Return the lines beyond whose edge, at some distances, there is no lane along most of them."""
    sides = _sides(lines, outward)
    along, side = sides.grid(_SAMPLE_M)
    if not len(along):
        return sides
    edge, out, _ = sides.stands(along)
    free: Mask = np.ones(len(edge), np.bool_)
    for away in outward_m:
        free &= are_free(edge + away * out, 0.0, GROUND, lanes)
    kept = np.bincount(side, free) > 0.5 * np.bincount(side)
    return _sides([line for line, keep in zip(lines, kept, strict=True) if keep], outward)


def _chains(lanes: dict[tuple[str, str], Lane]) -> list[list[tuple[str, str]]]:
    """Return roads in a row, one straight on after the other; they end where roads join or part."""
    following, before = defaultdict[str, list[tuple[str, str]]](list), defaultdict[str, int](int)
    for road in lanes:
        following[road[0]].append(road)
        before[road[1]] += 1
    chained: dict[tuple[str, str], tuple[str, str]] = {}
    for road, lane in lanes.items():
        onward = following[road[1]]
        if len(onward) == 1 and before[road[1]] == 1:
            turn = lanes[onward[0]].heading_at(0.0) - lane.heading_at(lane.length)
            if abs(wrap_angle(turn)) < _STRAIGHT_ON_RAD:
                chained[road] = onward[0]
    inner, chains = set(chained.values()), []
    for first in (road for road in lanes if road not in inner):
        chain = [first]
        while (after := chained.get(chain[-1])) is not None and after not in chain:
            chain.append(after)
        chains.append(chain)
    return chains


def _way_chains(ways: Footways) -> list[Floats]:
    """Return lines through the nodes of ways beside the road, as long as these go on without a corner."""
    beside = (ways.neighbours >= 0) & ~np.take_along_axis(ways.crossing, np.maximum(ways.neighbours, 0), axis=1)
    linked: list[set[int]] = [set() for _ in ways.nodes]
    for start, place in np.argwhere(beside).tolist():
        end = int(ways.neighbours[start, place])
        linked[start].add(end)
        linked[end].add(start)
    through = [_goes_on(ways.nodes, node, sorted(ends)) for node, ends in enumerate(linked)]
    done, chains = set[tuple[int, int]](), []
    for inside in (False, True):  # lines from their ends first; rings, which have none, last
        for node, ends in enumerate(linked):
            if through[node] != inside:
                continue
            for after in sorted(ends):
                if (node, after) in done:
                    continue
                chain = [node, after]
                while through[chain[-1]] and chain[-1] != node:
                    chain += [end for end in linked[chain[-1]] if end != chain[-2]]
                done |= {pair for a, b in pairwise(chain) for pair in ((a, b), (b, a))}
                chains.append(ways.nodes[chain])
    return chains


def _in_parts(line: Floats) -> list[Floats]:
    """Cut a line through points (K, 2) m into parts that are not much longer than lots of a street."""
    along = np.diff(line, axis=0)
    start = np.concatenate([[0.0], np.cumsum(exact.hypot(along[:, 0], along[:, 1]))])
    cuts = np.unique(np.searchsorted(start, np.arange(0.0, start[-1], _LOTS_M)[1:]))
    cuts = cuts[(cuts > 0) & (cuts < len(line) - 1)].tolist()
    return [line[a : b + 1] for a, b in pairwise([0, *cuts, len(line) - 1])]


def _goes_on(nodes: Floats, node: int, ends: list[int]) -> bool:
    """Return whether a line goes on at a node with these neighbours."""
    if len(ends) != 2:
        return False
    (ax, ay), (bx, by) = nodes[node] - nodes[ends[0]], nodes[ends[1]] - nodes[node]
    return bool(abs(exact.arctan2(ax * by - ay * bx, ax * bx + ay * by)) < _STRAIGHT_ON_RAD)


def _within(lane: Lane, area: Floats) -> Lane:
    """Return the part of a lane that is in an area; all of it if it is bent or not very long."""
    if not isinstance(lane, StraightLane) or lane.length < float(np.abs(area[1] - area[0]).max()):
        return lane
    along = np.clip([lane.local_coordinates(corner)[0] for corner in area], 0.0, lane.length)
    start, end = float(along.min()), max(float(along.max()), float(along.min()) + 1.0)
    return StraightLane(lane.position(start, 0.0), lane.position(end, 0.0), lane.width)
