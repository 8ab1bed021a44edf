"""A drawn town as other programs see one: streets with both directions, ways over junctions, and rings.

Streets come from the plan, before lanes are made of it. Ways over junctions come from the description and its lanes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import lines_cross
from coopsim.geometry.se3 import Floats
from coopsim.world.custom.conflicts import middle_line
from coopsim.world.drawn_options import TownOptions
from coopsim.world.places.description import PlaceDescription
from coopsim.world.places.road_network import Lane, Road, RoadNetwork
from coopsim.world.towns.plan import Junction, Plan, Street, StreetEnd, Stretch
from coopsim.world.towns.planning import draw_plan
from coopsim.world.towns.roads import TownRoads, lay_roads
from coopsim.world.towns.town import draw_place


@dataclass(frozen=True, slots=True)
class LaneEnd:
    """A lane that a way begins or ends at.

    Attributes:
        road: name of its street (`s3`) or of its piece of a ring (`j2r1`).
        forwards: it leads from the beginning of that to the end.
        lane: its number, from the inner one outwards.
    """

    road: str
    forwards: bool
    lane: int


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way over a junction.

    Attributes:
        road: nodes of the description.
        junction: name of the junction: `j3`, `j3a0` (arm 0 of a roundabout) or `s5` (the loop of street 5).
        start: the lane before it.
        end: the lane behind it.
        lanes: its parts, straight or bent, in order.
        priority: others give way.
        kerbed: a pavement is beside it, on the outer side.
    """

    road: Road
    junction: str
    start: LaneEnd
    end: LaneEnd
    lanes: tuple[Lane, ...]
    priority: bool = False
    kerbed: bool = True

    @property
    def line(self) -> Floats:
        """Its middle (K, 2) m."""
        return np.concatenate([middle_line(lane)[k > 0 :] for k, lane in enumerate(self.lanes)])


@dataclass(frozen=True, slots=True, eq=False)
class Ring:
    """A piece of a roundabout's ring, from the way in of an arm to the way out of the next one."""

    name: str
    lane: Lane
    start: str
    end: str


@dataclass(frozen=True, slots=True, eq=False)
class TownNetwork:
    """Roads of a drawn town.

    Attributes:
        name: name of the place.
        plan: streets and junctions, neither turned nor mirrored.
        description: all that the place has.
        lanes: its lanes.
        ways: ways over junctions.
        rings: pieces of rings between ways.
        inner_left: 1 where the inner side of lanes is the left one; -1 where vehicles keep to the left.
    """

    name: str
    plan: Plan
    description: PlaceDescription
    lanes: RoadNetwork
    ways: tuple[Way, ...]
    rings: tuple[Ring, ...]
    inner_left: int

    @property
    def junctions(self) -> dict[str, list[Way]]:
        """Ways by the junctions that they lie in."""
        found: dict[str, list[Way]] = {}
        for way in self.ways:
            found.setdefault(way.junction, []).append(way)
        return found

    def place(self, points: Floats) -> Floats:
        """Return places (N, 2) m in the world of places (N, 2) m of the plan."""
        cos, sin = exact.cos(self.plan.turn_rad), exact.sin(self.plan.turn_rad)
        x, y = points.T
        return np.column_stack([cos * x - sin * y, self.inner_left * (sin * x + cos * y)])

    def stretches(self, street: Street) -> list[Stretch]:
        """Return the centre line of a street in the world, where it has lanes."""
        (low, high), found, first = street.span_m, list[Stretch](), 0.0
        for each in street.line:
            begin, end = max(low - first, 0.0), min(high - first, each.length_m)
            first += each.length_m
            if end > begin:
                start = self.place(each.position(np.array([begin]), np.zeros(1)))[0]
                heading = self.inner_left * (float(each.heading(np.array([begin]))[0]) + self.plan.turn_rad)
                found.append(Stretch(start, heading, end - begin, self.inner_left * each.curvature_1_m))
        return found

    def junction_at(self, street: Street, end: StreetEnd) -> str:
        """Return the name of the junction at a street's end."""
        if end.junction is None:
            return f"s{street.number}"
        return _junction_name(self.plan.junctions[end.junction], end.arm)

    def first_ways(self, junction: str) -> list[tuple[Way, Way]]:
        """Return the pairs of ways over a junction of which the second gives way to the first."""
        ways = self.junctions[junction]
        lines = {way.road: way.line for way in ways}
        return [
            (first, other)
            for first in ways
            for other in ways
            if first.priority and not other.priority and first.start != other.start
            and (first.end == other.end or lines_cross(lines[first.road], lines[other.road]))
        ]  # fmt: skip


def _junction_name(junction: Junction, arm: int) -> str:
    """Return the name of a junction; each arm of a roundabout is one."""
    return f"j{junction.number}" + (f"a{arm}" if junction.kind == "roundabout" else "")


def town_network(place_seed: int, options: TownOptions) -> TownNetwork:
    """Draw a town's roads."""
    plan, place = draw_plan(place_seed, options), draw_place(place_seed, options)
    assert place.description is not None, "it was built from one"
    reading = _Reading(plan, lay_roads(plan), place.description, place.make_layout().network)
    for junction in plan.junctions:
        if junction.kind == "roundabout":
            reading.add_ring(junction)
        else:
            reading.add_turns(junction)
    for street in plan.streets:
        if street.end.junction is None:
            reading.add_loop(street)
    ways, rings = tuple(reading.ways), tuple(reading.rings)
    side = -1 if options.traffic_side == "left" else 1
    return TownNetwork(place.name, plan, place.description, reading.lanes, ways, rings, side)


class _Reading:
    """Ways of a description, with the lanes that they lead from and to; these are known by the names of nodes."""

    def __init__(self, plan: Plan, roads: TownRoads, description: PlaceDescription, lanes: RoadNetwork) -> None:
        self.plan, self.roads, self.lanes = plan, roads, lanes
        self.given = {(each.start, each.end): each for each in description.roads}
        self.ways, self.rings = list[Way](), list[Ring]()

    def add_turns(self, junction: Junction) -> None:
        """Add the ways over a junction without a ring."""
        arms = range(len(junction.arms))
        for arm, other, lane in product(arms, arms, range(junction.lanes)):
            road = self.roads.stops[junction.number, arm][lane], self.roads.exits[junction.number, other][lane]
            if road in self.given:
                beside = lane == junction.lanes - 1 and other == (arm + 1) % len(arms)
                start, end = self._street(junction, arm, lane, -1), self._street(junction, other, lane, 1)
                self._add(road, _junction_name(junction, arm), start, end, beside)

    def add_ring(self, junction: Junction) -> None:
        """Add the ring of a roundabout, and the ways in and out."""
        stub, count = f"j{junction.number}", len(junction.arms)
        for arm in range(count):
            (stop,), (way_out,) = (each[junction.number, arm] for each in (self.roads.stops, self.roads.exits))
            before, after = (LaneEnd(f"{stub}r{number}", True, 0) for number in ((arm - 1) % count, arm))
            own, enters, leaves = _junction_name(junction, arm), f"{stub}in{arm}", f"{stub}out{arm}"
            self._add((stop, enters), own, self._street(junction, arm, 0, -1), after, True)
            self._add((leaves, way_out), own, before, self._street(junction, arm, 0, 1), True)
            self._add((leaves, enters), own, before, after, False)
            onward = (arm + 1) % count
            piece = self.lanes.get_lane((enters, f"{stub}out{onward}", 0))
            self.rings.append(Ring(after.road, piece, own, _junction_name(junction, onward)))

    def add_loop(self, street: Street) -> None:
        """Add the turning loop at the end of a street."""
        (ahead,), (back,) = (each[None, street.number] for each in (self.roads.stops, self.roads.exits))
        name = f"s{street.number}"
        self._add((ahead, back), name, LaneEnd(name, True, 0), LaneEnd(name, False, 0), True)

    def _street(self, junction: Junction, arm: int, lane: int, out: int) -> LaneEnd:
        """Return a lane at an arm, `out` 1 outwards and -1 inwards."""
        each = junction.arms[arm]
        return LaneEnd(f"s{each.street}", each.outwards == (out > 0), lane)

    def _add(self, road: Road, junction: str, start: LaneEnd, end: LaneEnd, kerbed: bool) -> None:
        given = self.given[road]
        names = [road[0], *(f"{road[0]}>{road[1]}.{k}" for k in range(3) if given.turn == "around"), road[1]]
        lanes = tuple(self.lanes.get_lane((*pair, 0)) for pair in pairwise(names))
        self.ways.append(Way(road, junction, start, end, lanes, given.priority, kerbed))
