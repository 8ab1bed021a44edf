"""A road network as arrays, and lane coordinates as kernels.

`along` and `aside` are coordinates of a lane, m; aside is positive to the left of the direction of travel (in this
world, whose y points up; highway-env draws it downwards).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.places.road_network import CircularLane, RoadNetwork, StraightLane
from coopsim.world.traffic.fleet import Vehicle, dtype_of
from coopsim.world.traffic.rules import VEHICLE_LENGTH_M, draw_turn, wrap

STRAIGHT, CIRCULAR = range(2)


class LaneRow(Protocol):
    """A lane."""

    kind: int  # `STRAIGHT` or `CIRCULAR`
    road: int  # number of its road
    number: int  # on its road; 0 is the leftmost
    forbidden: bool  # no driver may change to it
    x: float  # of its start, or of an arc's center, m
    y: float  # of its start, or of an arc's center, m
    dir_x: float  # direction of a straight lane
    dir_y: float  # direction of a straight lane
    heading: float  # of a straight lane, rad
    length: float  # m
    width: float  # m
    speed_limit: float  # m/s
    radius: float  # of an arc, m
    start_phase: float  # of an arc, rad
    turn: float  # of an arc, 1 to the left and -1 to the right
    low_x: float  # of an upright box around the middle line, m
    low_y: float  # of that box, m
    high_x: float  # of that box, m
    high_y: float  # of that box, m


class RoadRow(Protocol):
    """A road: lanes side by side."""

    start: int  # node it leads from
    end: int  # node it leads to
    first_lane: int  # number of its first lane; its others follow
    lanes: int  # how many lanes it has
    first_way: int  # where the roads that continue from its end start in `LaneArrays.ways`
    ways: int  # how many roads continue


LANE, ROAD = dtype_of(LaneRow), dtype_of(RoadRow)


class LaneArrays(NamedTuple):
    """A road network for kernels; lanes and roads in the network's order.

    Attributes:
        lanes: (L,) `LANE`.
        roads: (R,) `ROAD`.
        ways: (W,) roads that continue from roads' ends.
    """

    lanes: NDArray[Any]
    roads: NDArray[Any]
    ways: Ints


class NumberedNetwork:
    """A road network with numbers for lanes and roads.

    Attributes:
        source: the roads.
        lane_index: names of lanes by number.
        lane_number: numbers of lanes by name.
        roads: nodes that each road leads from and to, by number.
        road_number: numbers of roads by their nodes.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self.source = network
        self.lane_index = tuple(network.lanes)
        self.lane_number = {lane: k for k, lane in enumerate(self.lane_index)}
        self.roads = tuple((start, end) for start, ends in network.graph.items() for end in ends)
        self.road_number = {road: k for k, road in enumerate(self.roads)}

    @cached_property
    def arrays(self) -> LaneArrays:
        """The network for kernels.

        Raises:
            InvalidValueError: a lane is neither straight nor an arc.
        """
        roads, ways = self._roads(self.source)
        return LaneArrays(self._lanes(self.source), roads, ways)

    def _lanes(self, network: RoadNetwork) -> NDArray[Any]:
        table = np.zeros(len(self.lane_index), dtype=LANE)
        for row, (index, lane) in zip(table, network.lanes.items(), strict=True):
            row["road"], row["number"] = self.road_number[index[:2]], index[2]
            row["length"], row["width"], row["forbidden"] = lane.length, lane.width, lane.forbidden
            row["speed_limit"] = lane.speed_limit
            if isinstance(lane, StraightLane):
                _fill_straight(row, lane)
            elif isinstance(lane, CircularLane):
                _fill_circular(row, lane)
            else:
                raise InvalidValueError(
                    f"lanes must be of type StraightLane or CircularLane, got {type(lane).__name__} at {index}"
                )
        return table

    def _roads(self, network: RoadNetwork) -> tuple[NDArray[Any], Ints]:
        table, ways = np.zeros(len(self.road_number), dtype=ROAD), list[int]()
        nodes: dict[str, int] = {}
        for (start, end), k in self.road_number.items():
            onward = [self.road_number[end, beyond] for beyond in network.graph.get(end, {})]
            lanes = len(network.graph[start][end])
            names = (nodes.setdefault(node, len(nodes)) for node in (start, end))
            table[k] = (*names, self.lane_number[start, end, 0], lanes, len(ways), len(onward))
            ways += onward
        return table, np.array(ways, dtype=np.int64)


def _fill_straight(row: Any, lane: StraightLane) -> None:
    row["kind"] = STRAIGHT
    row["x"], row["y"] = lane.start
    row["dir_x"], row["dir_y"] = lane.direction
    row["heading"] = lane.heading
    row["low_x"], row["low_y"] = np.minimum(lane.start, lane.end)
    row["high_x"], row["high_y"] = np.maximum(lane.start, lane.end)


def _fill_circular(row: Any, lane: CircularLane) -> None:
    row["kind"] = CIRCULAR
    row["x"], row["y"] = lane.center
    row["radius"], row["start_phase"], row["turn"] = lane.radius, lane.start_phase, lane.turn
    row["low_x"], row["low_y"] = lane.center - lane.radius
    row["high_x"], row["high_y"] = lane.center + lane.radius


@njit(cache=True, nogil=True)
def local_coordinates(lane: LaneRow, x: float, y: float) -> tuple[float, float]:
    """Return along and aside of a place."""
    dx, dy = x - lane.x, y - lane.y
    if lane.kind == CIRCULAR:
        # Adding and subtracting the start phase rounds as highway-env does.
        phase = lane.start_phase + wrap(math.atan2(dy, dx) - lane.start_phase)
        along = lane.turn * (phase - lane.start_phase) * lane.radius
        return along, lane.turn * (lane.radius - math.sqrt(dx * dx + dy * dy))
    return dx * lane.dir_x + dy * lane.dir_y, dy * lane.dir_x - dx * lane.dir_y


@njit(cache=True, nogil=True)
def position_at(lane: LaneRow, along: float) -> tuple[float, float]:
    """Return a place on the middle line."""
    if lane.kind == CIRCULAR:
        phase = lane.turn * along / lane.radius + lane.start_phase
        return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)
    return lane.x + along * lane.dir_x, lane.y + along * lane.dir_y


@njit(cache=True, nogil=True)
def heading_at(lane: LaneRow, along: float) -> float:
    """Return the heading of the middle line, rad."""
    if lane.kind == CIRCULAR:
        return lane.turn * along / lane.radius + lane.start_phase + math.pi / 2 * lane.turn
    return lane.heading


@njit(cache=True, nogil=True)
def distance_to(lane: LaneRow, x: float, y: float) -> float:
    """Return how far aside plus how far before the start or past the end a place is."""
    along, aside = local_coordinates(lane, x, y)
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0)


@njit(cache=True, nogil=True)
def distance_to_box(lane: LaneRow, x: float, y: float) -> float:
    """Return the distance to the box around the middle line, a lower bound of `distance_to`."""
    dx = max(lane.low_x - x, 0.0, x - lane.high_x)
    dy = max(lane.low_y - y, 0.0, y - lane.high_y)
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True, nogil=True)
def closest_lane(lanes: NDArray[Any], x: float, y: float, heading: float, guess: int) -> int:
    """Return the lane with the least sum of distance (m) and angle (rad), the first of equals.

    `guess` only saves time.
    """
    best = guess
    least = _distance_with_heading(lanes[guess], x, y, heading)
    for k in range(len(lanes)):
        if distance_to_box(lanes[k], x, y) > least + 1e-9:
            continue
        distance = _distance_with_heading(lanes[k], x, y, heading)
        if distance < least or (distance == least and k < best):
            best, least = k, distance
    return best


@njit(cache=True, nogil=True)
def _distance_with_heading(lane: LaneRow, x: float, y: float, heading: float) -> float:
    along, aside = local_coordinates(lane, x, y)
    angle = abs(wrap(heading - heading_at(lane, along)))
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0) + angle


@njit(cache=True, nogil=True)
def plan_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """Draw turns until the route is full, or the road ends."""
    here = network.lanes[vehicle.target_lane].road
    if vehicle.route_length == 0 or route[0, 0] != here:
        # Without a lane's number: where a route has one, MOBIL changes no lane.
        route[0, 0], route[0, 1] = here, -1
        vehicle.route_length = 1
    while vehicle.route_length < len(route):
        road: RoadRow = network.roads[route[vehicle.route_length - 1, 0]]
        if road.ways == 0:
            return
        turn = draw_turn(vehicle.turn_key, vehicle.turns, road.ways)
        vehicle.turns += 1
        route[vehicle.route_length, 0] = network.ways[road.first_way + turn]
        route[vehicle.route_length, 1] = -1
        vehicle.route_length += 1


@njit(cache=True, nogil=True)
def lane_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints, k: int) -> int:
    """Return the lane of the route's road `k`: the one that the route names, or that with the present number."""
    road: RoadRow = network.roads[route[k, 0]]
    number: int = route[k, 1]
    if number < 0:
        number = min(network.lanes[vehicle.target_lane].number, road.lanes - 1)
    return road.first_lane + number


@njit(cache=True, nogil=True)
def start_of_route(network: LaneArrays, vehicle: Vehicle, route: Ints) -> float:
    """Return the distance to the start of the route's first road, m; <= 0, because the vehicle is on it."""
    lane = network.lanes[lane_of_route(network, vehicle, route, 0)]
    return -local_coordinates(lane, vehicle.x, vehicle.y)[0]


@njit(cache=True, nogil=True)
def follow_road(network: LaneArrays, vehicle: Vehicle, route: Ints) -> None:
    """Target the next lane at the end of the target lane."""
    lane = network.lanes[vehicle.target_lane]
    along, _ = local_coordinates(lane, vehicle.x, vehicle.y)
    if along > lane.length - VEHICLE_LENGTH_M / 2:
        x, y = position_at(lane, along)
        vehicle.target_lane = _next_lane(network, vehicle, route, x, y)


@njit(cache=True, nogil=True)
def _next_lane(network: LaneArrays, vehicle: Vehicle, route: Ints, x: float, y: float) -> int:
    """Return the route's next lane, or without a route the closest to (x, y); the same lane where the road ends."""
    here = network.lanes[vehicle.target_lane].road
    if vehicle.route_length > 0 and route[0, 0] == here:
        for k in range(1, vehicle.route_length):
            route[k - 1, 0], route[k - 1, 1] = route[k, 0], route[k, 1]
        vehicle.route_length -= 1
    if vehicle.route_length > 0 and network.roads[route[0, 0]].start == network.roads[here].end:
        return _lane_on_road(network, vehicle.target_lane, route[0, 0], route[0, 1], x, y)
    best, least = vehicle.target_lane, np.inf
    for k in range(network.roads[here].ways):
        way = network.ways[network.roads[here].first_way + k]
        lane = _lane_on_road(network, vehicle.target_lane, way, -1, x, y)
        distance = distance_to(network.lanes[lane], x, y)
        if distance < least:
            best, least = lane, distance
    return best


@njit(cache=True, nogil=True)
def _lane_on_road(network: LaneArrays, lane: int, way: int, number: int, x: float, y: float) -> int:
    """Return the lane of the same number (or `number`, if >= 0) on a road with as many lanes, else the closest."""
    road: RoadRow = network.roads[way]
    if network.roads[network.lanes[lane].road].lanes == road.lanes:
        return road.first_lane + (number if number >= 0 else network.lanes[lane].number)
    best, least = road.first_lane, np.inf
    for k in range(road.first_lane, road.first_lane + road.lanes):
        distance = distance_to(network.lanes[k], x, y)
        if distance < least:
            best, least = k, distance
    return best
