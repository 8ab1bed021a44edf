"""Situation 7: overtaking on a two-way road, into the way of an oncoming car that the overtaken truck hides.

NHTSA's pre-crash scenario "vehicles making a maneuver, opposite direction" (Najm, Smith and Yanagisawa, DOT HS 810 767,
2007), in the form of AutoCastSim's overtaking (Cui et al., "Coopernaut", CVPR 2022): the truck stands and blocks the
lane.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import CircularLane, Lane, LaneIndex, Road, RoadNetwork, StraightLane
from coopsim.world.script import VehicleRole
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing
from coopsim.world.situations.sites import Reach, Way, find_way, oncoming_way, way_through, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_HIDING = (ObjectClass.TRUCK, ObjectClass.BUS)
_LATERAL_M_S2 = 1.96  # a little less than `coopsim.world.traffic.way_ahead` allows: the ego keeps its speed
_PAST_M = 3.0  # from the truck's front to where the ego begins to pull in
_SPARE_M = 6.0  # of the lane, before and after the way past the truck
_LATER_S = (2.2, 3.2)  # an oncoming car after the one that conflicts
_AFTER_M = 20.0
_ASIDE_M = (0.0, 0.5)  # of the truck, from the middle of its lane towards the oncoming one
_TRIES = 4  # places on each lane


@SITUATIONS.register("overtaking")
@dataclass(frozen=True, kw_only=True, eq=False)
class Overtaking(Situation):
    """The ego pulls out to pass a truck that stands in its lane; the truck hides an oncoming car.

    The route leads into the oncoming lane and back. Until the oncoming car has passed, the ego can wait behind the
    truck.

    Attributes:
        speed_m_s: speed of the ego: 16 to 25 km/h, as of cars that pull out from behind a truck.
        oncoming_m_s: speed of the oncoming car: 35 to 50 km/h.
        meets_m: place where the two would meet if neither reacted, from the truck's rear on.
        beside_m: place where the ego has reached the oncoming lane, from the truck's rear on.
    """

    speed_m_s: Range = (4.5, 7.0)
    oncoming_m_s: Range = (9.7, 13.9)
    meets_m: Range = (1.0, 8.0)
    beside_m: Range = (-1.0, 3.0)

    name = "overtaking"
    named: ClassVar[str] = "parking_street"
    over_s: float = 14.0

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        ranges = (self.speed_m_s, self.oncoming_m_s, self.meets_m, self.beside_m)
        speed, towards_m_s, meets_m, beside_m = (draw(rng, ends) for ends in ranges)
        truck, ego = draw_model(rng, *_HIDING), draw_model(rng, ObjectClass.CAR)
        length_m, radius_m = float(truck.size_m[0]), speed**2 / _LATERAL_M_S2
        reach = Reach(speed * CONFLICT_S, _AFTER_M, speed, speed * (CONFLICT_S + HEADWAY_S[1]))
        towards = Reach(towards_m_s * CONFLICT_S, _AFTER_M, towards_m_s, towards_m_s * (CONFLICT_S + _LATER_S[1]))
        for index, aside_m, share in _straight_lanes(layout, rng):
            detour = Detour(radius_m, aside_m, length_m + _PAST_M - beside_m, -layout.outer_side)
            room_m = layout.network.get_lane(index).length - detour.length_m - 2 * _SPARE_M
            start_m = _SPARE_M + share * room_m
            way = find_way(layout.network, index, start_m + detour.swing_m + meets_m - beside_m, reach)
            oncoming = None if way is None else oncoming_way(way, towards, layout.outer_side)
            if room_m > 0 and way is not None and oncoming is not None:
                break
        else:
            return None
        network, around = detour.add_to(layout.network, index, start_m)
        roads = [road for each in way.roads for road in (around if each == index[:2] else (each,))]
        past = way_through(network, roads, roads.index(around[1]), detour.arc_m + meets_m - beside_m)
        limits = dict.fromkeys(roads, speed) | dict.fromkeys(oncoming.roads, towards_m_s)
        truck_aside_m = -layout.outer_side * draw(rng, _ASIDE_M)
        blocks = (around[0][1], around[-1][0], 0), detour.swing_m - beside_m + length_m / 2
        return Stage(
            with_limits(replace(layout, network=network), limits),
            passing(EGO, past, CONFLICT_S, speed, connected=True, model=ego.name),
            (
                passing("oncoming", oncoming, CONFLICT_S, towards_m_s, manner="unyielding", conflicts=True),
                VehicleRole(
                    "truck",
                    *blocks,
                    0.0,
                    (),
                    ObjectClass(truck.label),
                    "parked",
                    aside_m=truck_aside_m,
                    model=truck.name,
                ),
                passing("later", oncoming, CONFLICT_S + draw(rng, _LATER_S), towards_m_s),
                passing("behind", past, CONFLICT_S + draw(rng, HEADWAY_S), speed),
            ),
            (),
            way.position(0.0),
        )


@dataclass(frozen=True, slots=True)
class Detour:
    """A way from a straight lane to one side, beside it, and back.

    Attributes:
        radius_m: radius of its four bends.
        aside_m: distance to the side.
        beside_m: length beside the lane.
        side: the side, 1: left, -1: right.
    """

    radius_m: float
    aside_m: float
    beside_m: float
    side: int = 1

    @property
    def turned_rad(self) -> float:
        """The angle of each bend."""
        return float(exact.arccos(1 - self.aside_m / (2 * self.radius_m)))

    @property
    def swing_m(self) -> float:
        """The length along the lane of the two bends that lead aside, and of the two that lead back."""
        return 2 * self.radius_m * float(exact.sin(self.turned_rad))

    @property
    def arc_m(self) -> float:
        """The length of two bends along themselves."""
        return 2 * self.radius_m * self.turned_rad

    @property
    def length_m(self) -> float:
        """The length of the lane that is passed."""
        return 2 * self.swing_m + self.beside_m

    def add_to(self, network: RoadNetwork, index: LaneIndex, start_m: float) -> tuple[RoadNetwork, tuple[Road, ...]]:
        """Return a network with the detour, and the roads that take the lane's place on a way that takes it.

        The lane is divided in three; the detour leaves it at `start_m`.
        """
        lane, divided = network.get_lane(index), RoadNetwork()
        for other, each in network.lanes.items():
            if other != index:
                divided.add_lane(*other[:2], each)
        out_m, in_m = start_m, start_m + self.length_m
        nodes = (index[0], "pull_out", "swing_out", "beside", "past", "swing_in", "pull_in", index[1])
        around = tuple(pairwise(nodes))
        for road, ends in (
            (around[0], (0.0, out_m)),
            (("pull_out", "pull_in"), (out_m, in_m)),
            (around[-1], (in_m, lane.length)),
        ):
            start, end = (lane.position(along, 0.0) for along in ends)
            divided.add_lane(*road, StraightLane(start, end, lane.width, lane.speed_limit))
        for road, piece in zip(around[1:-1], self._pieces(lane, start_m), strict=True):
            divided.add_lane(*road, piece)
        return divided, around

    def _pieces(self, lane: Lane, start_m: float) -> Iterator[Lane]:
        """Yield the pieces of the detour from a straight lane."""
        heading, turned, radius = lane.heading_at(0.0), self.side * self.turned_rad, self.radius_m
        low, high = heading - self.side * math.pi / 2, heading + self.side * math.pi / 2  # from the centres of bends
        out_m = start_m + self.swing_m
        back_m, in_m = out_m + self.beside_m, out_m + self.beside_m + self.swing_m
        rest = (lane.width, lane.speed_limit)

        def at(along_m: float, aside_m: float) -> Floats:
            return lane.position(along_m, self.side * aside_m)

        yield CircularLane(at(start_m, radius), radius, low, low + turned, *rest)
        yield CircularLane(at(out_m, self.aside_m - radius), radius, high + turned, high, *rest)
        yield StraightLane(at(out_m, self.aside_m), at(back_m, self.aside_m), *rest)
        yield CircularLane(at(back_m, self.aside_m - radius), radius, high, high - turned, *rest)
        yield CircularLane(at(in_m, radius), radius, low - turned, low, *rest)


def _straight_lanes(layout: Layout, rng: np.random.Generator) -> Iterator[tuple[LaneIndex, float, float]]:
    """Yield straight lanes outside junctions, the distances to the oncoming lanes (m), and shares of their lengths.

    Both are drawn. Each lane comes with several shares, in [0, 1], as some parts of it may lack the room.
    """
    lanes = list(layout.network.lanes.items())
    for k in rng.permutation(len(lanes)).tolist():
        index, lane = lanes[k]
        if isinstance(lane, StraightLane) and index[:2] not in layout.movements:
            way = Way(layout.network, (index,), np.array([-lane.length / 2]))
            oncoming = oncoming_way(way, Reach(0.0, 0.0, 0.0), layout.outer_side)
            if oncoming is not None:
                aside_m = float(exact.norm(way.position(0.0) - oncoming.position(0.0)))
                yield from ((index, aside_m, share) for share in rng.random(_TRIES).tolist())
