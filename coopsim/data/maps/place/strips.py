"""Lanes and ways of a map as strips from node to node, as a place needs them.

Lanes that follow each other become one; a lane that opens or closes beside another begins or ends in that one; where
lanes join, their last metres are strips of their own, at whose beginnings vehicles give way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np
from scipy.spatial import cKDTree

from coopsim.data.maps.check import driven_lanes
from coopsim.data.maps.place.lines import (
    curve_between,
    part_of,
    rounded,
    simplified,
    spaced,
    turn_rad,
    turns_rad,
)
from coopsim.data.maps.street_map import StreetLane, StreetMap, StreetWay, Turn
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats

_SHORT_M = 3.0  # shorter lanes become parts of the ways that lead to them
_LENGTH_M, _LEAST_M = 10.0, 1.0  # that ways which are as short take of a lane; shortest way
_SAME_M = 20.0  # shorter lanes take the limit of the lane that they become a part of
_JOIN_M, _APART_M = 30.0, 45.0  # of lanes that join: the last metres, where lanes are this long
_BESIDE_M = 8.0  # between the ends of lanes beside each other
_SHIFT = 10.0  # metres ahead for each metre aside, where a lane opens or closes
_SHARP_RAD, _KINK_RAD, _AHEAD_M = np.radians(35.0), np.radians(44.0), 2.0
_TIGHT_M, _TURN_M = (
    3.0,
    3.0,
)  # ways that bend more tightly, over such a length, are left out where one to the same road does not
_NEAR_M, _STEP_M = 2.5, 1.0  # ways over a junction that come nearer than this conflict


@dataclass(slots=True, eq=False)
class Strip:
    """A lane or a way.

    Attributes:
        name: name of the lane or way; a join's ends in "~".
        start: node.
        end: node.
        line: middle (K, 3) m.
        width_m: (K,).
        speed_m_s: limit; None: the file has none.
        way: the way that it is; None: a lane.
        left: lane on its left.
        right: lane on its right.
        yields: names of strips to which its vehicles give way; None: nobody says.
    """

    name: str
    start: str
    end: str
    line: Floats
    width_m: Floats
    speed_m_s: float | None
    way: StreetWay | None = None
    left: str | None = None
    right: str | None = None
    yields: tuple[str, ...] | None = None

    @property
    def turn(self) -> Turn:
        """Direction in which it leads over a junction."""
        return "straight" if self.way is None else self.way.turn

    @property
    def length_m(self) -> float:
        """Length in the plane."""
        return float(along_of(self.line)[-1])

    def append(self, other: Strip) -> None:
        """Lead on over another strip."""
        self.line = np.concatenate([self.line, other.line[1:]])
        self.width_m = np.concatenate([self.width_m, other.width_m[1:]])
        self.end = other.end


@dataclass(slots=True, eq=False)
class Strips:
    """Strips of a map, by name, lanes before ways."""

    all: dict[str, Strip] = field(default_factory=dict)

    def ending(self, node: str) -> list[Strip]:
        """Return the strips that end at a node."""
        return [each for each in self.all.values() if each.end == node]

    def by_node(self) -> tuple[dict[str, list[Strip]], dict[str, list[Strip]]]:
        """Return the strips that end, and those that start, at each node."""
        ending, starting = dict[str, list[Strip]](), dict[str, list[Strip]]()
        for each in self.all.values():
            ending.setdefault(each.end, []).append(each)
            starting.setdefault(each.start, []).append(each)
        return ending, starting


def strips_of(streets: StreetMap) -> Strips:
    """Return the strips of a map that is cut out."""
    found = Strips()
    nodes = _nodes(streets)
    for lane in driven_lanes(streets):
        ends = nodes[lane.id, 0], nodes[lane.id, 1]
        found.all[lane.id] = Strip(
            lane.id, *ends, lane.line, lane.width_m, lane.speed_m_s, left=lane.left, right=lane.right
        )
    bent = {way.id: _bent(way, streets) for way in streets.ways.values() if way.turn != "around"}
    tight = {name for name in bent if _radius_m(bent[name][0]) < _TIGHT_M}
    wide = {_between(streets.ways[name], streets) for name in bent.keys() - tight}
    for name, (line, width_m) in bent.items():
        way = streets.ways[name]
        if name not in tight or _between(way, streets) not in wide:
            ends = nodes[way.start, 1], nodes[way.end, 0]
            found.all[name] = Strip(name, *ends, line, width_m, way.speed_m_s, way)
    _open_and_close(found)
    _chain(found)
    _contract(found)
    _lengthen(found)
    _keep_one_each(found)
    _meet(found)
    _smooth(found)
    _join(found)
    return found


def _between(way: StreetWay, streets: StreetMap) -> tuple[str, str]:
    """Return the lane that a way leads from, and the road that it leads to."""
    return way.start, streets.lanes[way.end].road


def _bent(way: StreetWay, streets: StreetMap) -> tuple[Floats, Floats]:
    """Return the line and widths of a way, drawn anew where it turns at once."""
    lanes = streets.lanes[way.start], streets.lanes[way.end]
    before, after = (part_of(lane.line, lane.width_m, *_near(lane, end)) for end, lane in enumerate(lanes))
    start, end = before[0][[0, -1]], after[0][[0, -1]]
    line, width_m = rounded(way.line, way.width_m)
    steps = [start, *(line[k : k + 2] for k in range(len(line) - 1)), end]
    if max(turn_rad(a, b) for a, b in pairwise(steps)) < _SHARP_RAD:
        return line, width_m
    line = curve_between(start[1], start[1] - start[0], end[0], end[1] - end[0])
    return line, np.linspace(width_m[0], width_m[-1], len(line))


def _radius_m(line: Floats) -> float:
    """Return the least radius of a line's turn, over `_TURN_M`."""
    points = spaced(line, _STEP_M / 2)
    step = points[1:] - points[:-1]
    heading = np.unwrap(exact.arctan2(step[:, 1], step[:, 0]))
    count = max(min(round(2 * _TURN_M / _STEP_M), len(heading) - 1), 1)
    return count * _STEP_M / 2 / float(np.abs(heading[count:] - heading[:-count]).max(initial=1e-6))


def _near(lane: StreetLane, end: int) -> tuple[float, float]:
    """Return the part of a lane, m, by which its direction at its start (1) or end (0) counts."""
    length_m = lane.length_m
    reach_m = min(_AHEAD_M, length_m)
    return (0.0, reach_m) if end else (length_m - reach_m, length_m)


def _nodes(streets: StreetMap) -> dict[tuple[str, int], str]:
    """Return a node for the start (0) and the end (1) of each driven lane; lanes that lead on share one."""
    parent = {(lane.id, end): (lane.id, end) for lane in driven_lanes(streets) for end in (0, 1)}

    def root(key: tuple[str, int]) -> tuple[str, int]:
        while parent[key] != key:
            key = parent[key]
        return key

    for start, after in streets.links.items():
        for end in after:
            parent[root((end, 0))] = root((start, 1))
    return {key: "{}{}".format(root(key)[0], "<>"[root(key)[1]]) for key in parent}


def _open_and_close(strips: Strips) -> None:
    """Let lanes that nothing leads to, or that lead to nothing, begin and end in a lane beside that goes on."""
    for end in (0, 1):
        for _ in range(len(strips.all)):  # a lane may open beside one that opens
            ending, starting = strips.by_node()
            others = starting if end else ending
            loose = [each for each in strips.all.values() if (each.end if end else each.start) not in others]
            found = [
                (each, strips.all[side])
                for each in loose
                for side in (each.left, each.right)
                if side in strips.all and (strips.all[side].end if end else strips.all[side].start) in others
                if _gap_m(each.line, strips.all[side].line, -end) < _BESIDE_M  # not where one is cut
            ]
            if not found:
                break
            _lead(*found[0], end)


def _gap_m(line: Floats, other: Floats, k: int) -> float:
    """Return the distance between points with the same number of two lines, in the plane."""
    return float(np.hypot(*(line[k] - other[k])[:2]))


def _lead(strip: Strip, beside: Strip, end: int) -> None:
    """Let a strip begin (0) or end (1) where that beside it does."""
    flip = slice(None, None, -1 if end else 1)
    line, width_m = strip.line[flip], strip.width_m[flip]
    node = beside.line[flip][0]
    aside_m = _gap_m(line, node[None], 0)
    length_m = strip.length_m
    line, width_m = part_of(line, width_m, min(_SHIFT * aside_m, 0.8 * length_m), length_m)
    line, width_m = np.vstack([node, line]), np.concatenate([beside.width_m[flip][:1], width_m])
    strip.line, strip.width_m = line[flip], width_m[flip]
    if end:
        strip.end, strip.yields = beside.end, (beside.name,)
    else:
        strip.start = beside.start


def _chain(strips: Strips) -> None:
    """Make one of lanes that follow each other, where no other leads on or joins, and limits are the same.

    Ways that meet no other way are as lanes.
    """
    _make_lanes(strips)
    ending, starting = strips.by_node()
    into: dict[str, str] = {}
    for node, before in ending.items():
        after = starting.get(node, [])
        if len(before) != 1 or len(after) != 1 or before[0].start == after[0].end or before[0].way or after[0].way:
            continue
        first, second = before[0], after[0]
        short = min(first.length_m, second.length_m) < _SAME_M
        if first.speed_m_s != second.speed_m_s and not short:
            continue
        if first.length_m < second.length_m:
            first.speed_m_s = second.speed_m_s
        first.append(second)
        first.yields = second.yields
        ending[first.end] = [first if each is second else each for each in ending[first.end]]
        del strips.all[second.name]
        into[second.name] = first.name
    for each in strips.all.values():
        each.left, each.right = _last(each.left, into), _last(each.right, into)
        each.yields = None if each.yields is None else tuple(_last(name, into) or name for name in each.yields)


def _make_lanes(strips: Strips) -> None:
    """Make lanes of ways without lights that lead straight on, and meet no other way of their junction."""
    inside: dict[str, list[Strip]] = {}
    for each in strips.all.values():
        if each.way:
            inside.setdefault(each.way.junction, []).append(each)
    for ways in inside.values():
        met = {number for pair in conflicts_of(ways) for number in pair}
        for number, each in enumerate(ways):
            lit = each.way is None or each.way.program is not None or each.way.signals
            if number not in met and not lit and each.turn == "straight":
                each.way = None


def _lengthen(strips: Strips) -> None:
    """Let ways that are too short go on over a part of a lane; leave out those that cannot."""
    for way in [each for each in strips.all.values() if each.way and each.length_m < _SHORT_M]:
        ending, starting = strips.by_node()
        after, before = starting.get(way.end, []), ending.get(way.start, [])
        node = f"{way.name}|"
        if len(ending[way.end]) == 1 and len(after) == 1 and after[0].way is None:
            lane, share_m = after[0], min(_LENGTH_M, after[0].length_m / 2)
            part = part_of(lane.line, lane.width_m, 0.0, share_m)
            lane.line, lane.width_m = part_of(lane.line, lane.width_m, share_m, lane.length_m)
            way.line, way.width_m = np.concatenate([way.line, part[0]]), np.concatenate([way.width_m, part[1]])
            way.end = lane.start = node
        elif len(starting[way.start]) == 1 and len(before) == 1 and before[0].way is None:
            lane, share_m = before[0], before[0].length_m - min(_LENGTH_M, before[0].length_m / 2)
            part = part_of(lane.line, lane.width_m, share_m, lane.length_m)
            lane.line, lane.width_m = part_of(lane.line, lane.width_m, 0.0, share_m)
            way.line, way.width_m = np.concatenate([part[0], way.line]), np.concatenate([part[1], way.width_m])
            way.start = lane.end = node
        elif way.length_m < _LEAST_M:
            del strips.all[way.name]


def _last(name: str | None, into: dict[str, str]) -> str | None:
    while name in into:
        name = into[name]
    return name


def _contract(strips: Strips) -> None:
    """Make lanes that are too short to stand on parts of what leads to them."""
    for strip in [each for each in strips.all.values() if each.way is None and each.length_m < _SHORT_M]:
        before = [each for each in strips.ending(strip.start) if each is not strip]
        alone = all(each is strip for each in strips.all.values() if each.start == strip.start)
        if before and alone:
            for each in before:
                each.append(strip)
        if alone:
            del strips.all[strip.name]
    starts = {each.end for each in strips.all.values() if each.way is None}
    ends = {each.end for each in strips.all.values()}
    for strip in [each for each in strips.all.values() if each.way and each.start not in starts | ends]:
        del strips.all[strip.name]


def _keep_one_each(strips: Strips) -> None:
    """Leave out further strips between the same nodes, and those that lead back to where they begin."""
    first: dict[tuple[str, str], str] = {}
    for each in list(strips.all.values()):
        if each.start == each.end or first.setdefault((each.start, each.end), each.name) != each.name:
            del strips.all[each.name]


def _meet(strips: Strips) -> None:
    """Let strips meet at their nodes: where a lane begins, else where one ends."""
    places = {each.end: each.line[-1] for each in strips.all.values() if each.way is None}
    places |= {each.start: each.line[0] for each in strips.all.values() if each.way is None}
    for each in strips.all.values():
        line = np.array(each.line)
        line[0], line[-1] = places.get(each.start, line[0]), places.get(each.end, line[-1])
        places.setdefault(each.end, line[-1])
        each.line = line


def _smooth(strips: Strips) -> None:
    """Leave out points that are not needed, round corners, and part strips where the way turns too sharply."""
    for each in strips.all.values():
        each.line, each.width_m = rounded(*simplified(each.line, each.width_m))
    lanes = [each for each in strips.all.values() if each.way is None]
    before, after = ({each.end: each.line[-2:] for each in lanes}, {each.start: each.line[:2] for each in lanes})
    for way in [each for each in strips.all.values() if each.way]:
        start, end = before.get(way.start, way.line[:2]), after.get(way.end, way.line[-2:])
        if max(turn_rad(start, way.line[:2]), turn_rad(way.line[-2:], end)) > _SHARP_RAD:
            way.line = curve_between(way.line[0], start[1] - start[0], way.line[-1], end[1] - end[0])
            way.width_m = np.linspace(way.width_m[0], way.width_m[-1], len(way.line))
            if turns_rad(way.line).max() > _KINK_RAD:
                del strips.all[way.name]
    ending, starting = strips.by_node()
    for node, found in ending.items():
        for each, other in product(found, starting.get(node, ())):
            if turn_rad(each.line[-2:], other.line[:2]) > _KINK_RAD:
                other.start = f"{node}:{other.name}"


def _join(strips: Strips) -> None:
    """Divide lanes that join others, and say which of them gives way: that which turns more, or is slower."""
    ending, starting = strips.by_node()
    tails: dict[str, str] = {}
    for node, before in ending.items():
        lanes = [each for each in before if each.way is None]
        if len(before) < 2 or not lanes:
            continue
        after = starting.get(node, [])
        order = sorted(lanes, key=lambda each: (each.yields is not None, -(each.speed_m_s or 0.0), _turn(each, after)))
        for rank, each in enumerate(order):
            tail = _tail(each)
            tail.yields = tuple(other.name for other in order[:rank])
            strips.all[tail.name] = tail
            tails[each.name] = tail.name
    for each in strips.all.values():
        each.yields = None if each.yields is None else tuple(tails.get(name, name) for name in each.yields)


def _turn(strip: Strip, after: Iterable[Strip]) -> float:
    return min((turn_rad(strip.line[-2:], each.line[:2]) for each in after), default=0.0)


def _tail(strip: Strip) -> Strip:
    """Divide a lane where it is long enough; return what vehicles enter when they have given way."""
    length_m = strip.length_m
    if length_m < _APART_M:
        return strip
    last = part_of(strip.line, strip.width_m, length_m - _JOIN_M, length_m)
    node = f"{strip.name}|"
    tail = Strip(f"{strip.name}~", node, strip.end, *last, strip.speed_m_s)
    strip.line, strip.width_m = part_of(strip.line, strip.width_m, 0.0, length_m - _JOIN_M)
    strip.end, strip.yields = node, None
    return tail


def conflicts_of(ways: Sequence[Strip]) -> list[tuple[int, int]]:
    """Return pairs of numbers of ways from different lanes that cross or join."""
    points = [spaced(each.line, _STEP_M)[:, :2] for each in ways]
    owner = np.repeat(np.arange(len(ways)), [len(each) for each in points])
    pairs = owner[cKDTree(np.concatenate(points)).query_pairs(_NEAR_M, output_type="ndarray")]
    found = sorted({(int(a), int(b)) for a, b in np.unique(np.sort(pairs, axis=1), axis=0)})
    return [(a, b) for a, b in found if ways[a].start != ways[b].start]
