"""Roads of a description: between named nodes, straight, bent, along several points, or a turning loop."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.errors import UnknownNameError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types.driving import OUTER_SIDES
from coopsim.world.custom.conflicts import conflicting_roads
from coopsim.world.places.description import MapLane, PlaceDescription
from coopsim.world.places.layout import LANE_M, ROADS_AHEAD
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import Lane, Road, RoadNetwork
from coopsim.world.places.signals import Signal
from coopsim.world.places.streets import LOOP_SPEED_M_S, SPEED_M_S, add_bend, add_straight, turning_loop
from coopsim.world.traffic.rules import LOOK_AHEAD_M

SHORTEST_M = 5.0
"""Least length of a piece: drivers leave it when the middle of a usual car is half its length from the end."""

CURVED_M = 1.0
"""Least length of a curved lane."""

STEP_M = 0.1
"""Least distance between two points of a curved lane."""

TIGHTEST_M = 5.0
"""Least radius of a bend."""

_CENTRE_M = 0.05  # tolerance between the distances of a bend's two ends from its centre
_KINK_RAD, _CURVED_KINK_RAD = np.radians(20.0), np.radians(45.0)  # where a lane is curved its corners are rounded


@dataclass(slots=True, eq=False)
class Roads:
    """Roads of a description.

    Attributes:
        description: the lanes, their nodes and all else.
        root: the description's entry, for errors.
        nodes: (2,) m, by name.
        network: all pieces, one lane each.
        pieces: pieces of every road, in order.
        number: place of every road in the list.
        movements: pieces that others cross or join, or that have a light.
        priority: movements to which others give way.
        yields: movements to which one gives way, by that one.
        signals: traffic lights.
    """

    description: PlaceDescription
    root: Entry
    nodes: Mapping[str, Floats]
    network: RoadNetwork = field(default_factory=RoadNetwork)
    pieces: dict[Road, list[Road]] = field(default_factory=dict)
    number: dict[Road, int] = field(default_factory=dict)
    movements: tuple[Road, ...] = ()
    priority: tuple[Road, ...] = ()
    yields: dict[Road, tuple[Road, ...]] = field(default_factory=dict)
    signals: tuple[Signal, ...] = ()

    def entry(self, road: Road, *keys: str) -> Entry:
        """Return the entry of a road, or of a part of it."""
        return self.root.part("roads", self.number[road], *keys)

    def lane(self, piece: Road) -> Lane:
        """Return a piece's lane."""
        return self.network.get_lane((*piece, 0))

    def length_m(self, road: Road) -> float:
        """Return a road's length, all pieces together."""
        return float(sum(self.lane(piece).length for piece in self.pieces[road]))

    def piece_at(self, road: Road, along_m: float) -> tuple[Road, float]:
        """Return the piece at a distance from the road's start, and the distance from its own start, m."""
        for piece in self.pieces[road][:-1]:
            if along_m < self.lane(piece).length:
                return piece, along_m
            along_m -= self.lane(piece).length
        return self.pieces[road][-1], along_m

    def find(self, names: Sequence[str], *keys: str | int) -> Road:
        """Return the road that the names of its nodes stand for, in the part of the description that keys lead to."""
        road = (names[0], names[-1]) if len(names) == 2 else ("", "")
        if road not in self.pieces:
            known = ", ".join(f"[{start}, {end}]" for start, end in self.pieces)
            message = f"{keys[-1]} must be a road, got [{', '.join(names)}]. Accepted: {known}"
            raise self.root.part(*keys).error(message)
        return road

    @property
    def fastest_m_s(self) -> float:
        """The highest speed limit."""
        return float(max(lane.speed_limit for lane in self.network.lanes.values()))

    @property
    def ahead(self) -> int:
        """The number of pieces that a driver has to plan ahead to know all within sight."""
        graph = self.network.graph
        onward = {(start, end): [(end, to) for to in graph.get(end, ())] for start in graph for end in graph[start]}
        least_m, count = dict.fromkeys(onward, 0.0), 1  # behind the end of a piece, over the shortest that follow
        while count < ROADS_AHEAD or min(least_m.values()) < LOOK_AHEAD_M:
            least_m = {
                piece: min((self.lane(way).length + least_m[way] for way in ways), default=LOOK_AHEAD_M)
                for piece, ways in onward.items()
            }
            count += 1
        return count


def build_roads(description: PlaceDescription, root: Entry) -> Roads:
    """Build the lanes of a description; `root` is its entry, for errors."""
    found = Roads(description, root, {name: np.array(at, dtype=np.float64) for name, at in description.nodes.items()})
    for number, lane in enumerate(description.roads):
        _add_road(found, number, lane)
    if not found.pieces:
        raise root.part("roads").error("roads must be at least one, got none")
    if not description.cut:
        _require_ways_on(found)
    _require_no_kinks(found)
    _require_neighbours(found)
    found.movements = conflicting_roads(found.network)
    ranked = {road for road, number in found.number.items() if description.roads[number].priority}
    for road in [road for road in found.pieces if road in ranked]:
        if not set(found.pieces[road]) & set(found.movements):
            useless = found.entry(road).error("priority is of no use: no other road crosses or joins this one")
            warnings.warn(str(useless), stacklevel=2)
    first = {piece for road in ranked for piece in found.pieces[road]}
    found.priority = tuple(piece for piece in found.movements if piece in first)
    return found


def _add_road(roads: Roads, number: int, lane: MapLane) -> None:
    """Add the pieces of a road."""
    road, entry = (lane.start, lane.end), roads.root.part("roads", number)
    for key, name in zip(("from", "to"), road, strict=True):
        if name not in roads.nodes:
            raise entry.part(key).error(str(UnknownNameError("node", name, roads.nodes)))
    if lane.start == lane.end:
        raise entry.error(f"a road must lead from one node to another, got {lane.start!r} twice")
    if road in roads.pieces:
        there = roads.entry(road).spot
        raise entry.error(f"a road from {lane.start!r} to {lane.end!r} is there already, in {there}")
    roads.number[road] = number
    bent = bool(lane.via) or lane.curved
    if (lane.centre is not None) != (lane.turn in ("left", "right")) or (bent and lane.turn is not None):
        raise entry.error("a bend has both centre and turn (left or right), a loop turn: around, other roads neither")
    points = np.array([roads.nodes[lane.start], *lane.via, roads.nodes[lane.end]], dtype=np.float64)
    if lane.widths_m and (lane.width_m is not None or lane.turn is not None or len(lane.widths_m) != len(points)):
        raise entry.part("widths_m").error(
            f"widths_m must be {len(points)} numbers, for each point of a straight road without width_m"
        )
    usual_m_s = LOOP_SPEED_M_S if lane.turn == "around" else SPEED_M_S
    speed_m_s = float(usual_m_s if lane.speed_m_s is None else lane.speed_m_s)
    shape = (speed_m_s, float(LANE_M if lane.width_m is None else lane.width_m))
    if lane.turn == "around":
        roads.pieces[road] = _add_loop(roads, road, shape)
    elif lane.curved:
        roads.pieces[road] = [road]
        _add_curved(roads, road, points, lane.widths_m or shape[1], speed_m_s)
    elif lane.centre is not None:
        roads.pieces[road] = [road]
        _add_arc(roads, lane, shape)
    else:
        widths_m = [min(ends) for ends in pairwise(lane.widths_m)] or [shape[1]] * (len(points) - 1)
        roads.pieces[road] = _add_line(roads, road, points, [(speed_m_s, float(width_m)) for width_m in widths_m])
    if lane.traffic_per_h is not None:
        roads.network.traffic_per_h |= dict.fromkeys(roads.pieces[road], float(lane.traffic_per_h))


def _add_line(roads: Roads, road: Road, points: Floats, shapes: Sequence[tuple[float, float]]) -> list[Road]:
    """Add straight pieces from point to point."""
    names = [road[0], *(f"{road[0]}>{road[1]}.{k}" for k in range(len(points) - 2)), road[1]]
    pieces = list(pairwise(names))
    for piece, ends, shape in zip(pieces, pairwise(points), shapes, strict=True):
        length_m = float(exact.norm(ends[1] - ends[0]))
        if length_m < SHORTEST_M:
            message = f"every piece must be at least {SHORTEST_M:g} m long, got {length_m:.2f} m"
            raise roads.entry(road, *(["via"] if len(points) > 2 else [])).error(message)
        add_straight(roads.network, piece, ends, *shape)
    return pieces


def _add_curved(
    roads: Roads, road: Road, points: Floats, widths_m: float | tuple[float, ...], speed_m_s: float
) -> None:
    """Add one lane along points (K, 2) m."""
    steps_m = exact.norm(np.diff(points, axis=0))
    if steps_m.min() < STEP_M or steps_m.sum() < CURVED_M:
        raise roads.entry(road, "via").error(
            f"points of a curved lane must be {STEP_M:g} m apart or more, and it {CURVED_M:g} m long or more, got "
            f"{steps_m.min():.2f} m and {steps_m.sum():.2f} m"
        )
    lane = PolylineLane(points, widths_m, speed_m_s)
    if (turned := float(np.abs(np.diff(lane.corners["heading"])).max())) > _CURVED_KINK_RAD:
        raise roads.entry(road, "via").error(
            f"a curved lane must turn by {np.degrees(_CURVED_KINK_RAD):.0f} degrees at most at each point, got "
            f"{np.degrees(turned):.0f}: write more points"
        )
    roads.network.add_lane(*road, lane)


def _add_arc(roads: Roads, lane: MapLane, shape: tuple[float, float]) -> None:
    road, turn, middle = (lane.start, lane.end), lane.turn, np.array(lane.centre, dtype=np.float64)
    centre = roads.entry(road, "centre")
    (start, radius), (end, other) = (_polar(roads.nodes[node] - middle) for node in road)
    if abs(radius - other) > _CENTRE_M:
        raise centre.error(
            f"centre must be equally far from both ends, got {radius:.2f} m from {road[0]!r} and {other:.2f} m from "
            f"{road[1]!r}"
        )
    if radius < TIGHTEST_M:
        raise centre.error(f"centre must be at least {TIGHTEST_M:g} m from the ends, got {radius:.2f} m")
    swept = (end - start) % (2 * np.pi) if turn == "left" else -((start - end) % (2 * np.pi))
    if abs(swept) > np.pi + 1e-9:
        raise centre.error(
            f"a bend must be at most half a turn, got {np.degrees(abs(swept)):.0f} degrees to the {turn}: "
            "make it of two"
        )
    if radius * abs(swept) < SHORTEST_M:
        raise centre.error(f"a bend must be at least {SHORTEST_M:g} m long, got {radius * abs(swept):.2f} m")
    add_bend(roads.network, road, middle, (radius, start, start + swept), *shape)


def _add_loop(roads: Roads, road: Road, shape: tuple[float, float]) -> list[Road]:
    """Add bends from the end of one lane to the beginning of the next one, on its inner side."""
    inner = -OUTER_SIDES[roads.description.traffic_side]
    start, end = (roads.nodes[node] for node in road)
    across, half_m = end - start, float(exact.norm(end - start)) / 2
    if not 1.5 <= half_m <= 8.0:
        raise roads.entry(road).error(
            f"a loop must lead from one lane to the next, 3 to 16 m to its {'left' if inner > 0 else 'right'}, got "
            f"{2 * half_m:.2f} m"
        )
    ahead_rad = float(exact.arctan2(across[1], across[0])) - inner * np.pi / 2
    cos, sin = exact.cos(ahead_rad), exact.sin(ahead_rad)
    names = [road[0], *(f"{road[0]}>{road[1]}.{k}" for k in range(3)), road[1]]
    pieces = list(pairwise(names))
    for piece, ((x, y), (radius, first, last)) in zip(pieces, turning_loop(half_m), strict=True):
        centre = (start + end) / 2 + [cos * x - inner * sin * y, sin * x + inner * cos * y]
        add_bend(roads.network, piece, centre, (radius, inner * first + ahead_rad, inner * last + ahead_rad), *shape)
    return pieces


def _polar(offset: Floats) -> tuple[float, float]:
    """Return angle (rad) and distance (m)."""
    return float(exact.arctan2(offset[1], offset[0])), float(exact.hypot(*offset))


def _require_ways_on(roads: Roads) -> None:
    """Refuse dead ends: traffic never ends, so roads must not, either."""
    starts = {start for start, _ in roads.pieces}
    for road in roads.pieces:
        if (end := road[1]) not in starts:
            raise roads.entry(road).error(f"no road leads on from {end!r}: write one, as a loop (turn: around)")


def _require_no_kinks(roads: Roads) -> None:
    """Refuse corners too sharp to drive around."""
    onward: dict[str, list[Road]] = {}
    for road in roads.pieces:
        onward.setdefault(road[0], []).append(road)
    for road, pieces in roads.pieces.items():
        following = [(piece, road) for piece in pieces[1:]]
        following += [(roads.pieces[name][0], name) for name in onward.get(road[1], ())]
        before = [*pieces[:-1], *[pieces[-1]] * (len(following) - len(pieces) + 1)]
        for piece, (after, name) in zip(before, following, strict=True):
            lane = roads.lane(piece)
            turn = abs(float(wrap_angle(roads.lane(after).heading_at(0.0) - lane.heading_at(lane.length))))
            curved = isinstance(lane, PolylineLane) or isinstance(roads.lane(after), PolylineLane)
            most_rad = _CURVED_KINK_RAD if curved else _KINK_RAD
            if turn > most_rad:
                where = "within a road" if name == road else f"from this road to that in {roads.entry(name).spot}"
                raise roads.entry(road).error(
                    f"the way turns at once by {np.degrees(turn):.0f} degrees {where}, at most "
                    f"{np.degrees(most_rad):.0f} are accepted: write a bend (centre and turn)"
                )


def _require_neighbours(roads: Roads) -> None:
    """Refuse neighbours that are no roads, or have another neighbour on that side."""
    for road, number in roads.number.items():
        lane = roads.description.roads[number]
        for side, names in (("left", lane.left), ("right", lane.right)):
            if not names:
                continue
            beside = roads.description.roads[roads.number[roads.find(names, "roads", number, side)]]
            back = beside.right if side == "left" else beside.left
            if tuple(back) != road:
                raise roads.entry(road, side).error(
                    f"{side} must be a road that has this one as its other neighbour, [{', '.join(road)}], got one "
                    f"with [{', '.join(back)}]"
                )
