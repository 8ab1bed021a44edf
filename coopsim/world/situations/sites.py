"""Sites: where in a place a situation can happen, found from its roads, bays and buildings."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.layout import Layout
from coopsim.world.places.polyline import LATERAL_M_S2
from coopsim.world.places.road_network import Lane, LaneIndex, Road, RoadNetwork

_KINK_RAD = 0.1  # at most, between two lanes of a way: less than a steering movement
_TURN_RAD = 0.35  # at most, of a whole way: buildings and parked vehicles hide little around a bend
_ALONGSIDE_M = (2.2, 5.5)  # between the middles of a lane and of vehicles parked beside it
_ONCOMING_M = 8.0  # at most, between the middles of a lane and of the oncoming one
_ACROSS_RAD = (math.radians(60), math.radians(120))  # angles at which roads cross


@dataclass(frozen=True, slots=True)
class Reach:
    """Lengths that a way must have.

    Attributes:
        before_m: needed before the place of interest.
        after_m: needed after it.
        speed_m_s: speed at which bends of these lengths must be comfortable.
        wanted_m: length wanted before the place, if the roads have it.
    """

    before_m: float
    after_m: float
    speed_m_s: float
    wanted_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Lanes one after another, along which places are counted from a place of interest, in m.

    Attributes:
        network: the roads.
        lanes: the lanes.
        starts_m: (N,) where each begins; negative before the place of interest.
    """

    network: RoadNetwork
    lanes: tuple[LaneIndex, ...]
    starts_m: Floats

    @property
    def roads(self) -> tuple[Road, ...]:
        """The roads of the lanes."""
        return tuple((start, end) for start, end, _ in self.lanes)

    def find(self, along_m: float) -> tuple[LaneIndex, float]:
        """Return the lane at a place, and the distance from its start, m."""
        k = max(0, int(np.searchsorted(self.starts_m, along_m, side="right")) - 1)
        return self.lanes[k], along_m - float(self.starts_m[k])

    def roads_from(self, along_m: float) -> tuple[Road, ...]:
        """Return the roads from a place on."""
        return self.roads[self.lanes.index(self.find(along_m)[0]) :]

    def position(self, along_m: float, aside_m: float = 0.0) -> Floats:
        """Return a point (2,) m, `aside_m` to the left of the middle."""
        lane, along = self.find(along_m)
        point: Floats = self.network.get_lane(lane).position(along, aside_m)
        return point

    def heading(self, along_m: float) -> float:
        """Return the direction of travel at a place, rad."""
        lane, along = self.find(along_m)
        return float(self.network.get_lane(lane).heading_at(along))


def find_way(network: RoadNetwork, lane: LaneIndex, along_m: float, reach: Reach, *, turns: bool = False) -> Way | None:
    """Return the straightest way through a place on a lane; None: it is too short, or has a narrow bend.

    Before the part that is needed it goes on as far as is wanted, around bends, if the roads do.

    Args:
        network: the roads.
        lane: lane of the place of interest.
        along_m: distance of the place from the lane's start.
        reach: the lengths, and the speed at which bends must be comfortable.
        turns: the way may turn, as over a junction, in any bend.
    """
    kink_rad = math.pi if turns else _KINK_RAD
    lanes, low_m, high_m = [lane], -along_m, network.get_lane(lane).length - along_m
    while low_m > -reach.before_m:
        onto = _straightest(network, lanes[0], kink_rad, back=True)
        if onto is None or onto in lanes:
            return None
        lanes.insert(0, onto)
        low_m -= network.get_lane(onto).length
    while high_m < reach.after_m:
        onto = _straightest(network, lanes[-1], kink_rad, back=False)
        if onto is None or onto in lanes:
            return None
        lanes.append(onto)
        high_m += network.get_lane(onto).length
    found = [network.get_lane(each) for each in lanes]
    if not turns and any(comfortable_m_s(each) < reach.speed_m_s for each in found):
        return None
    if not turns and abs(wrap_angle(found[0].heading_at(0.0) - found[-1].heading_at(found[-1].length))) > _TURN_RAD:
        return None
    while low_m > -reach.wanted_m and (onto := _straightest(network, lanes[0], math.pi, back=True)) is not None:
        if onto in lanes:
            break
        lanes.insert(0, onto)
        low_m -= network.get_lane(onto).length
    lengths = [network.get_lane(each).length for each in lanes]
    return Way(network, tuple(lanes), low_m + np.append(0.0, np.cumsum(lengths)[:-1]))


def way_through(network: RoadNetwork, roads: Sequence[Road], number: int, along_m: float) -> Way:
    """Return the way along some roads with the place of interest on one of them.

    Args:
        network: the roads.
        roads: roads one after another; the way takes the first lane of each.
        number: number of the road of the place among these.
        along_m: distance of the place from that road's start; a negative one counts from its end.
    """
    lengths = [network.get_lane((*road, 0)).length for road in roads]
    place_m = sum(lengths[:number]) + along_m + (lengths[number] if along_m < 0 else 0.0)
    lanes = tuple((*road, 0) for road in roads)
    return Way(network, lanes, np.append(0.0, np.cumsum(lengths)[:-1]) - place_m)


def comfortable_m_s(lane: Lane) -> float:
    """Return the largest comfortable speed in a lane's bend, m/s; infinite on a straight lane."""
    return math.sqrt(LATERAL_M_S2 * lane.tightest_m)


def _straightest(network: RoadNetwork, lane: LaneIndex, kink_rad: float, *, back: bool) -> LaneIndex | None:
    """Return the lane that goes on from a lane with the least kink, or comes before it; None: each has a larger one."""
    start, end, number = lane
    here = network.get_lane(lane)
    if back:
        roads = [(other, start) for other, ends in network.graph.items() if start in ends]
    else:
        roads = [(end, other) for other in network.graph.get(end, {})]
    best, least = None, 2 * kink_rad
    for road in roads:
        lanes = network.graph[road[0]][road[1]]
        index = (*road, min(number, len(lanes) - 1))
        there = network.get_lane(index)
        ends = (
            (there.heading_at(there.length), here.heading_at(0.0))
            if back
            else (here.heading_at(here.length), there.heading_at(0.0))
        )
        # Straight on goes before a bend that begins in the same direction.
        kink, bend = (
            abs(wrap_angle(ends[1] - ends[0])),
            abs(wrap_angle(there.heading_at(there.length) - there.heading_at(0))),
        )
        if kink < kink_rad and kink + bend < least:
            best, least = index, float(kink + bend)
    return best


def with_limits(layout: Layout, limits: dict[Road, float]) -> Layout:
    """Return a layout with other speed limits on some roads, m/s; the given one stays."""
    network = RoadNetwork()
    for index, lane in layout.network.lanes.items():
        if index[:2] in limits:
            lane = copy.copy(lane)
            lane.speed_limit = min(limits[index[:2]], comfortable_m_s(lane))
        network.add_lane(*index[:2], lane)
    return replace(layout, network=network)


def oncoming_way(way: Way, reach: Reach, outer: int) -> Way | None:
    """Return the way of oncoming traffic past a way's place of interest, which it counts from as well.

    None: there is none, or it is too short for `reach`. `outer` is the place's `Layout.outer_side`.
    """
    here, heading = way.position(0.0), way.heading(0.0)
    near = []
    for index, along, aside, turned in _lanes_beside(way.network, here, heading):
        if math.pi - turned < _KINK_RAD and 0 < -outer * aside < _ONCOMING_M:
            near.append((-outer * aside, index, along))
    if not near:
        return None
    _, index, along = min(near)
    return find_way(way.network, index, along, reach)


def _lanes_beside(
    network: RoadNetwork, point: Floats, heading_rad: float
) -> Iterator[tuple[LaneIndex, float, float, float]]:
    """Yield straight lanes beside a point (2,): index, distance along, point's distance to the left, turn from it."""
    for index, lane in network.lanes.items():
        if lane.tightest_m < math.inf:
            continue
        along, aside = lane.local_coordinates(point)
        if 0 <= along <= lane.length:
            yield index, along, aside, abs(float(wrap_angle(lane.heading_at(along) - heading_rad)))


@dataclass(frozen=True, slots=True, eq=False)
class KerbSite:
    """A bay at the kerb of a straight street.

    Attributes:
        way: the ego's way past it; places count from the bay's middle.
        bay_m: distance of the bay's middle to the left of the way's middle: negative, it is to the right.
        room_m: distance from the way's middle to the nearest building on the bay's side, at most `FARTHEST_M`.
    """

    way: Way
    bay_m: float
    room_m: float


FARTHEST_M = 15.0
"""Buildings farther from a street are not looked for."""


def kerb_sites(layout: Layout, order: Sequence[int], reach: Reach) -> Iterator[KerbSite]:
    """Yield the sites at bays whose streets reach far enough, in the order of the bays' numbers (N,)."""
    outer = layout.outer_side
    for bay in (layout.bays[k] for k in order):
        here = np.array([bay.x_m, bay.y_m])
        beside = [
            (outer * aside, index, along)
            for index, along, aside, turned in _lanes_beside(layout.network, here, bay.heading_rad)
            if turned < _KINK_RAD and _ALONGSIDE_M[0] < outer * aside < _ALONGSIDE_M[1]
        ]
        if not beside:
            continue
        away_m, index, along = min(beside)
        way = find_way(layout.network, index, along, reach)
        if way is not None:
            yield KerbSite(way, outer * away_m, _room_m(layout, way))


def _room_m(layout: Layout, way: Way) -> float:
    """Return the distance to the nearest building at the kerb of a way's place of interest, at most `FARTHEST_M`."""
    start, end = way.position(0.0), way.position(0.0, layout.outer_side * FARTHEST_M)
    shares = [share for outline in layout.road_map.buildings if (share := first_share(start, end, outline)) is not None]
    return FARTHEST_M * min(shares, default=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class CornerSite:
    """Two streets that cross straight at a corner with a building.

    Attributes:
        way: the ego's way; places along it count from the crossing of the two middle lines.
        across: the other's way, with the same place of interest.
        side: 1: the other comes from the left, -1: from the right.
        movements: the pieces of the two ways over the junction.
    """

    way: Way
    across: Way
    side: int
    movements: tuple[Road, Road]


def corner_sites(
    layout: Layout, rng: np.random.Generator, own_reach: Reach, other_reach: Reach
) -> Iterator[CornerSite]:
    """Yield sites at pairs of movements that cross straight, in drawn order.

    Args:
        layout: the place.
        rng: draws the order.
        own_reach: needs of the ego's way.
        other_reach: needs of the other's way.
    """
    lanes = {road: layout.network.get_lane((*road, 0)) for road in layout.movements}
    straight = [road for road, lane in lanes.items() if lane.tightest_m == math.inf]
    pairs = [(a, b) for a in straight for b in straight if a != b]
    for k in rng.permutation(len(pairs)):
        own, other = (lanes[road] for road in pairs[k])
        turned = float(wrap_angle(other.heading_at(0.0) - own.heading_at(0.0)))
        if not _ACROSS_RAD[0] < abs(turned) < _ACROSS_RAD[1]:
            continue
        offset = other.position(0.0, 0.0) - own.position(0.0, 0.0)
        (ax, ay), (bx, by) = ((exact.cos(h), exact.sin(h)) for h in (own.heading_at(0.0), other.heading_at(0.0)))
        along, back = (float(offset[0] * y - offset[1] * x) / float(ax * by - ay * bx) for x, y in ((bx, by), (ax, ay)))
        if not (0 < along < own.length and 0 < back < other.length):
            continue
        ways = [
            find_way(layout.network, (*road, 0), at, reach)
            for road, at, reach in zip(pairs[k], (along, back), (own_reach, other_reach), strict=True)
        ]
        if ways[0] is not None and ways[1] is not None:
            yield CornerSite(ways[0], ways[1], 1 if turned < 0 else -1, pairs[k])


def is_hidden(layout: Layout, here: Floats, there: Floats) -> bool:
    """Return whether a building stands between two points (2,) m."""
    return any(first_share(here, there, outline) is not None for outline in layout.road_map.buildings)


def first_share(start: Floats, end: Floats, outline: Floats) -> float | None:
    """Return the share of the way from one point (2,) to another at which it enters a convex outline (K, 2).

    None: it does not. Cyrus and Beck's clipping (Computers and Graphics 3, 1978).
    """
    edges = np.roll(outline, -1, axis=0) - outline
    area = float((outline[:, 0] * edges[:, 1] - outline[:, 1] * edges[:, 0]).sum())
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) * (1 if area > 0 else -1)  # outwards
    height, slope = ((start - outline) * normals).sum(axis=1), normals @ (end - start)
    enters, leaves = 0.0, 1.0
    for above, rise in zip(height.tolist(), slope.tolist(), strict=True):
        if rise == 0:
            if above > 0:
                return None
        elif rise < 0:
            enters = max(enters, -above / rise)
        else:
            leaves = min(leaves, -above / rise)
    return enters if enters < leaves else None
