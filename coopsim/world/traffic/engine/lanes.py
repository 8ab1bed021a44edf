"""highway-env's road network as arrays, and its lane coordinates as kernels.

Along and aside are highway-env's longitudinal and lateral coordinates of a lane, m; aside is positive to
the left of the direction of travel (in this world, whose y points up; highway-env draws it downwards).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane, SineLane, StraightLane
from highway_env.road.road import RoadNetwork
from numba import njit
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.types import Ints
from coopsim.world.places.layout import LaneIndex
from coopsim.world.traffic.engine.records import dtype_of

STRAIGHT, SINE, CIRCULAR = range(3)

VEHICLE_LENGTH_M = 5.0
"""highway-env's usual vehicle: a lane reaches so far over both of its ends, and is done with half of it to go."""


class Lane(Protocol):
    """A lane.

    Attributes:
        kind: straight, sinusoidal or an arc.
        road: it belongs to.
        number: on its road; 0 is the leftmost.
        forbidden: nobody may change to it.
        x: where it starts, or the arc's middle, m.
        y: where it starts, or the arc's middle, m.
        dir_x: of a straight or sinusoidal one.
        dir_y: of a straight or sinusoidal one.
        heading: of a straight or sinusoidal one, rad.
        length: m.
        width: m.
        speed_limit: m/s.
        radius: of an arc, m.
        start_phase: of an arc, rad.
        turn: of an arc, 1 to the left and -1 to the right.
        amplitude: of a sinusoidal one, m.
        pulsation: of a sinusoidal one, rad/m.
        phase: of a sinusoidal one, rad.
        low_x: of an upright box around the middle line, m.
        low_y: of that box, m.
        high_x: of that box, m.
        high_y: of that box, m.
    """

    kind: int
    road: int
    number: int
    forbidden: bool
    x: float
    y: float
    dir_x: float
    dir_y: float
    heading: float
    length: float
    width: float
    speed_limit: float
    radius: float
    start_phase: float
    turn: float
    amplitude: float
    pulsation: float
    phase: float
    low_x: float
    low_y: float
    high_x: float
    high_y: float


class RoadRow(Protocol):
    """A road: lanes side by side.

    Attributes:
        start: the node it leads from.
        end: the node it leads to.
        first_lane: of its lanes, which follow each other.
        lanes: how many.
        first_way: where the roads that go on from its end start in `LaneArrays.ways`.
        ways: how many these are.
    """

    start: int
    end: int
    first_lane: int
    lanes: int
    first_way: int
    ways: int


LANE, ROAD = dtype_of(Lane), dtype_of(RoadRow)


class LaneArrays(NamedTuple):
    """What kernels know of a road network; lanes and roads in highway-env's order.

    Attributes:
        lanes: (L,) `LANE`.
        roads: (R,) `ROAD`.
        ways: (W,) roads that go on from a road's end, in highway-env's order.
    """

    lanes: NDArray[Any]
    roads: NDArray[Any]
    ways: Ints


class Network:
    """A road network, with numbers for names.

    Args:
        network: highway-env's.

    Attributes:
        source: highway-env's.
        lane_index: highway-env's names by the number of the lane.
        lane_number: the other way round.
        roads: names of the nodes that each road leads from and to.
        road_number: the other way round.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self.source = network
        index: list[LaneIndex] = list(network.lanes_dict())
        roads = [(start, end) for start, ends in network.graph.items() for end in ends]
        self.lane_number = {lane: k for k, lane in enumerate(index)}
        self.roads = tuple(roads)
        self.road_number = {road: k for k, road in enumerate(roads)}
        self.lane_index = tuple(index)

    @cached_property
    def arrays(self) -> LaneArrays:
        """Made when first asked for: highway-env's own stepping needs none.

        Raises:
            InvalidValueError: a lane is neither straight, nor sinusoidal, nor an arc.
        """
        return LaneArrays(self._lanes(self.source), *self._roads(self.source))

    def _lanes(self, network: RoadNetwork) -> NDArray[Any]:
        table = np.zeros(len(self.lane_index), dtype=LANE)
        for row, index in zip(table, self.lane_index, strict=True):
            lane = network.get_lane(index)
            if type(lane) not in _SHAPES:
                known = ", ".join(kind.__name__ for kind in _SHAPES)
                raise InvalidValueError(
                    f"traffic over arrays knows {known}, got {type(lane).__name__} at {index}; "
                    f"traffic='highway-env' takes any lane"
                )
            row["road"], row["number"] = self.road_number[index[:2]], index[2]
            row["length"], row["width"], row["forbidden"] = lane.length, lane.width, lane.forbidden
            row["speed_limit"] = np.inf if lane.speed_limit is None else lane.speed_limit
            _SHAPES[type(lane)](row, lane)
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


def _straight(row: Any, lane: StraightLane) -> None:
    row["kind"] = STRAIGHT
    row["x"], row["y"] = lane.start
    row["dir_x"], row["dir_y"] = lane.direction
    row["heading"] = lane.heading
    row["low_x"], row["low_y"] = np.minimum(lane.start, lane.end)
    row["high_x"], row["high_y"] = np.maximum(lane.start, lane.end)


def _sine(row: Any, lane: SineLane) -> None:
    _straight(row, lane)
    row["kind"] = SINE
    row["amplitude"], row["pulsation"], row["phase"] = lane.amplitude, lane.pulsation, lane.phase
    for corner, sign in (("low_x", -1), ("low_y", -1), ("high_x", 1), ("high_y", 1)):
        row[corner] += sign * abs(lane.amplitude)


def _circular(row: Any, lane: CircularLane) -> None:
    row["kind"] = CIRCULAR
    row["x"], row["y"] = lane.center
    row["radius"], row["start_phase"], row["turn"] = lane.radius, lane.start_phase, lane.direction
    row["low_x"], row["low_y"] = lane.center - lane.radius
    row["high_x"], row["high_y"] = lane.center + lane.radius


_SHAPES: dict[type[AbstractLane], Callable[[Any, Any], None]] = {
    StraightLane: _straight,
    SineLane: _sine,
    CircularLane: _circular,
}


@njit(cache=True, nogil=True)
def wrap(angle: float) -> float:
    """Into [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


@njit(cache=True, nogil=True)
def local_coordinates(lane: Lane, x: float, y: float) -> tuple[float, float]:
    """Along and aside of a place."""
    dx, dy = x - lane.x, y - lane.y
    if lane.kind == CIRCULAR:
        # Going there and back by the start phase rounds as highway-env does.
        phase = lane.start_phase + wrap(math.atan2(dy, dx) - lane.start_phase)
        along = lane.turn * (phase - lane.start_phase) * lane.radius
        return along, lane.turn * (lane.radius - math.sqrt(dx * dx + dy * dy))
    along = dx * lane.dir_x + dy * lane.dir_y
    aside = dy * lane.dir_x - dx * lane.dir_y
    if lane.kind == SINE:
        aside -= lane.amplitude * math.sin(lane.pulsation * along + lane.phase)
    return along, aside


@njit(cache=True, nogil=True)
def position_at(lane: Lane, along: float) -> tuple[float, float]:
    """A place on the middle line."""
    if lane.kind == CIRCULAR:
        phase = lane.turn * along / lane.radius + lane.start_phase
        return lane.x + lane.radius * math.cos(phase), lane.y + lane.radius * math.sin(phase)
    aside = 0.0
    if lane.kind == SINE:
        aside = lane.amplitude * math.sin(lane.pulsation * along + lane.phase)
    return lane.x + along * lane.dir_x - aside * lane.dir_y, lane.y + along * lane.dir_y + aside * lane.dir_x


@njit(cache=True, nogil=True)
def heading_at(lane: Lane, along: float) -> float:
    """Of the middle line, rad."""
    if lane.kind == CIRCULAR:
        return lane.turn * along / lane.radius + lane.start_phase + math.pi / 2 * lane.turn
    if lane.kind == SINE:
        slope = lane.amplitude * lane.pulsation * math.cos(lane.pulsation * along + lane.phase)
        return lane.heading + math.atan(slope)
    return lane.heading


@njit(cache=True, nogil=True)
def distance_to(lane: Lane, x: float, y: float) -> float:
    """How far aside plus how far before the start or past the end."""
    along, aside = local_coordinates(lane, x, y)
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0)


@njit(cache=True, nogil=True)
def distance_to_box(lane: Lane, x: float, y: float) -> float:
    """To the box around the middle line: never more than `distance_to`."""
    dx = max(lane.low_x - x, 0.0, x - lane.high_x)
    dy = max(lane.low_y - y, 0.0, y - lane.high_y)
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True, nogil=True)
def closest_lane(lanes: NDArray[Any], x: float, y: float, heading: float, guess: int) -> int:
    """The lane with the least sum of distance (m) and angle (rad), the first of equals; `guess` only saves time."""
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
def _distance_with_heading(lane: Lane, x: float, y: float, heading: float) -> float:
    along, aside = local_coordinates(lane, x, y)
    angle = abs(wrap(heading - heading_at(lane, along)))
    return abs(aside) + max(along - lane.length, 0.0) + max(-along, 0.0) + angle
