"""A road network as arrays for kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.support.arrays import dtype_of
from coopsim.types import Ints
from coopsim.world.places.polyline import CORNER, PolylineLane
from coopsim.world.places.road_network import CircularLane, Lane, RoadNetwork, StraightLane

STRAIGHT, CIRCULAR, POLYLINE = range(3)


class LaneRow(Protocol):
    """A lane."""

    kind: int  # `STRAIGHT`, `CIRCULAR` or `POLYLINE`
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
    radius: float  # of an arc, m; infinite for a straight lane
    start_phase: float  # of an arc, rad
    turn: float  # of an arc, 1 to the left and -1 to the right
    first_corner: int  # of a polyline: where its corners start in `LaneArrays.corners`
    corners: int  # of a polyline: how many it has
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
    inner_ways: int  # how many of these, the first ones, lead on without end


LANE, ROAD = dtype_of(LaneRow), dtype_of(RoadRow)


class LaneArrays(NamedTuple):
    """A road network for kernels; lanes and roads in the network's order.

    Attributes:
        lanes: (L,) `LANE`.
        roads: (R,) `ROAD`.
        ways: (W,) roads that continue from roads' ends, repeated by their traffic: turns are drawn among them.
        corners: (C,) `CORNER`, of all polylines.
    """

    lanes: NDArray[Any]
    roads: NDArray[Any]
    ways: Ints
    corners: NDArray[Any]


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
            InvalidValueError: a lane is neither straight nor an arc nor a polyline.
        """
        roads, ways = self._roads(self.source)
        polylines = [lane for lane in self.source.lanes.values() if isinstance(lane, PolylineLane)]
        corners = np.concatenate([np.zeros(0, CORNER), *(lane.corners for lane in polylines)])
        return LaneArrays(self._lanes(self.source), roads, ways, corners)

    def _lanes(self, network: RoadNetwork) -> NDArray[Any]:
        table, corners = np.zeros(len(self.lane_index), dtype=LANE), 0
        for row, (index, lane) in zip(table, network.lanes.items(), strict=True):
            row["road"], row["number"] = self.road_number[index[:2]], index[2]
            row["length"], row["width"], row["forbidden"] = lane.length, lane.width, lane.forbidden
            row["speed_limit"] = lane.speed_limit
            if type(lane) not in _FILL:
                accepted = ", ".join(kind.__name__ for kind in _FILL)
                raise InvalidValueError(f"lanes must be of a type in {accepted}, got {type(lane).__name__} at {index}")
            _FILL[type(lane)](row, lane)
            row["first_corner"] = corners
            corners += int(row["corners"])
        return table

    def _roads(self, network: RoadNetwork) -> tuple[NDArray[Any], Ints]:
        table, table_ways, endless = np.zeros(len(self.road_number), dtype=ROAD), list[int](), network.endless
        nodes: dict[str, int] = {}
        for (start, end), k in self.road_number.items():
            ways = [(end, beyond) for beyond in network.graph.get(end, {})]
            ways.sort(key=lambda way: way not in endless)
            ways = network.by_traffic(ways)
            onward, inner = [self.road_number[way] for way in ways], sum(way in endless for way in ways)
            lanes = len(network.graph[start][end])
            names = (nodes.setdefault(node, len(nodes)) for node in (start, end))
            table[k] = (*names, self.lane_number[start, end, 0], lanes, len(table_ways), len(onward), inner)
            table_ways += onward
        return table, np.array(table_ways, dtype=np.int64)


def _fill_straight(row: Any, lane: StraightLane) -> None:
    row["kind"], row["radius"] = STRAIGHT, np.inf
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


def _fill_polyline(row: Any, lane: PolylineLane) -> None:
    row["kind"], row["radius"], row["corners"] = POLYLINE, lane.tightest_m, len(lane.corners)
    row["low_x"], row["low_y"] = lane.points.min(axis=0)
    row["high_x"], row["high_y"] = lane.points.max(axis=0)


_FILL: dict[type[Lane], Callable[[Any, Any], None]] = {
    StraightLane: _fill_straight,
    CircularLane: _fill_circular,
    PolylineLane: _fill_polyline,
}
