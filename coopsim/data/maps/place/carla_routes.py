"""Routes of CARLA's benchmarks on the lanes of a place: files of its leaderboard, of Bench2Drive and of V2Xverse.

A file has `<routes>` with a `<route>` of `<waypoint x y>`, or of `<waypoints>` with `<position x y>`, for each drive.
As CARLA's planner does, each waypoint is put on the nearest lane, and the shortest way leads from one to the next.
Lanes are not changed on the way: where that would be needed, a waypoint is put on a lane of the same direction beside
it.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from coopsim.data.maps.elements import Element, numbers, read_elements
from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.layout import Layout, StartSlot
from coopsim.world.places.road_network import LaneIndex, RoadNetwork

_FAR_M = 10.0  # from the middle of the nearest lane a waypoint belongs to no lane; CARLA sets no limit
_BESIDE_M, _SAME_M = 8.0, 0.5  # lanes as much farther than the nearest are beside it, or at the same place
_ALONG_RAD = math.radians(60.0)  # between lanes of the same direction
_BESIDE_COST = 20.0  # metres of a detour that a metre beside a waypoint is worth
_BACK_M = 1.0  # a waypoint may be so far behind the one before
_END_M = 1.0  # left between a start and the ends of its lane
_ROOM_M = 12.0  # between the start and others
_AROUND_M = 60.0  # of the map around a route


@dataclass(frozen=True, slots=True, eq=False)
class GivenRoute:
    """A route of a file.

    Attributes:
        element: the element, for errors.
        points: (K, 2) m, K >= 2, its waypoints in the plane of CARLA's maps in OpenDRIVE, whose y points left.
    """

    element: Element
    points: Floats

    @property
    def around(self) -> tuple[float, float]:
        """Middle of its waypoints."""
        x, y = ((self.points.min(axis=0) + self.points.max(axis=0)) / 2).tolist()
        return x, y

    @property
    def radius_m(self) -> float:
        """Radius of the place that it needs."""
        return float(exact.norm(self.points - np.array(self.around)).max()) + _AROUND_M


def read_routes(path: str | Path) -> tuple[GivenRoute, ...]:
    """Read the routes of a file.

    Raises:
        MapFileError: the file is missing, no XML, or no file of routes; names file and line.
    """
    elements = read_elements(Path(path))
    root = next(elements)
    routes = tuple(_read(each) for each in elements if root.tag == "routes" and each.tag == "route")
    if not routes:
        raise root.error("has no routes; accepted: <routes> with <route> in it, as CARLA's leaderboard has them")
    return routes


def _read(element: Element) -> GivenRoute:
    marks = [*element.all("waypoint"), *element.at_path("waypoints", "position")]
    if len(marks) < 2:
        raise element.error(f"must have at least two waypoints, got {len(marks)}")
    return GivenRoute(element, numbers(marks, ("x", "y")) * [1.0, -1.0])


class _Leg(NamedTuple):
    """Lanes from the first waypoint to a place on the last of them, and what they cost."""

    cost: float
    lanes: tuple[LaneIndex, ...]
    start_m: float
    end_m: float


def start_on(layout: Layout, route: GivenRoute, centre: tuple[float, float]) -> tuple[Layout, float]:
    """Return a place whose first connected car starts on a route, and the distance to its end along the lanes, m.

    Args:
        layout: a place of the map, with its middle at `centre`.
        route: the route.
        centre: (x, y) m in the map's plane.

    Raises:
        MapFileError: a waypoint is on no lane, or no way leads to it; says which.
    """
    network, points = layout.network, route.points - np.array(centre)
    legs = {
        lane: _Leg(_BESIDE_COST * aside_m, (lane,), along_m, along_m)
        for lane, (along_m, aside_m) in _lanes_at(network, route, points, 0).items()
    }
    for k in range(1, len(points)):
        legs = _lead_on(network, legs, _lanes_at(network, route, points, k))
        if not legs:
            raise route.element.error(f"must lead along lanes, but no way leads to waypoint {k + 1}")
    best = min(legs.values())
    lengths_m = [network.get_lane(lane).length for lane in best.lanes]
    start_m = min(max(best.start_m, _END_M), max(lengths_m[0] - _END_M, 0.0))
    slot = StartSlot(best.lanes[0], start_m, tuple(lane[:2] for lane in best.lanes))
    return _with_start(layout, slot), sum(lengths_m[:-1]) + best.end_m - start_m


def _lanes_at(
    network: RoadNetwork, route: GivenRoute, points: Floats, k: int
) -> Mapping[LaneIndex, tuple[float, float]]:
    """Return places along the lanes at a waypoint and along those beside it, and how much farther away they are, m."""
    near: dict[LaneIndex, tuple[float, float]] = {}
    for index, lane in network.lanes.items():
        along_m, aside_m = lane.local_coordinates(points[k])
        if -_END_M <= along_m <= lane.length + _END_M and abs(aside_m) <= _FAR_M + _BESIDE_M:
            near[index] = min(max(float(along_m), 0.0), lane.length), abs(float(aside_m))
    nearest = min(near, key=lambda index: near[index][1], default=None)
    if nearest is None or near[nearest][1] > _FAR_M:
        x, y = route.points[k].tolist()
        town = f" of {route.element.get('town')}" * bool(route.element.get("town"))
        raise route.element.error(
            f"must have waypoints within {_FAR_M:g} m of the middle of a lane of the map, but the one at "
            f"x={x:g}, y={-y:g}{town} is not"
        )
    least_m, heading = near[nearest][1], network.get_lane(nearest).heading_at(near[nearest][0])
    return {
        index: (along_m, aside_m - least_m)
        for index, (along_m, aside_m) in near.items()
        if aside_m <= least_m + _SAME_M
        or abs(wrap_angle(network.get_lane(index).heading_at(along_m) - heading)) < _ALONG_RAD
    }


def _lead_on(
    network: RoadNetwork, legs: Mapping[LaneIndex, _Leg], goals: Mapping[LaneIndex, tuple[float, float]]
) -> dict[LaneIndex, _Leg]:
    """Return the cheapest legs to the next waypoint, by lane: Dijkstra's algorithm."""
    order, found, seen = count(), dict[LaneIndex, _Leg](), set[LaneIndex]()
    queue = [(leg.cost, next(order), leg) for leg in legs.values()]
    heapq.heapify(queue)
    while queue and len(found) < len(goals):
        cost, _, leg = heapq.heappop(queue)
        lane, length_m = leg.lanes[-1], network.get_lane(leg.lanes[-1]).length
        along_m, aside_m = goals.get(lane, (-math.inf, 0.0))
        if lane not in found and along_m >= leg.end_m - _BACK_M:
            more_m = max(along_m - leg.end_m, 0.0)
            found[lane] = leg._replace(cost=cost + more_m + _BESIDE_COST * aside_m, end_m=leg.end_m + more_m)
        if lane in seen:
            continue
        if leg.end_m == 0:
            seen.add(lane)
        for node, beside in network.graph.get(lane[1], {}).items():
            onto = (lane[1], node, min(lane[2], len(beside) - 1))
            further = _Leg(cost + length_m - leg.end_m, (*leg.lanes, onto), leg.start_m, 0.0)
            heapq.heappush(queue, (further.cost, next(order), further))
    return found


def _with_start(layout: Layout, slot: StartSlot) -> Layout:
    """Return a layout with another start, that of the first connected car, and without those too near to it."""
    here = layout.network.get_lane(slot.lane).position(slot.along_m, 0.0)
    places = np.array([layout.network.get_lane(each.lane).position(each.along_m, 0.0) for each in layout.slots])
    kept = np.flatnonzero(exact.norm(places.reshape(-1, 2) - here) > _ROOM_M).tolist()
    number = {old: new for new, old in enumerate(kept, start=1)}
    order = (0, *(number[k] for k in layout.connected_order if k in number))
    return replace(layout, slots=(slot, *(layout.slots[k] for k in kept)), connected_order=order)


def require_radius(route: GivenRoute, most_m: float) -> None:
    """Refuse a route that no place has room for.

    Raises:
        InvalidValueError: its place would have a radius above `most_m`.
    """
    if route.radius_m > most_m:
        raise InvalidValueError(
            f"routes must fit into places with a radius of {most_m:g} m, but route {route.element.get('id')!r} needs "
            f"{route.radius_m:.0f} m"
        )
