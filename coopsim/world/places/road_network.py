"""Lanes and the network they form; the geometry is highway-env's, number by number.

Coordinates of a lane: `along_m` from its start on the middle line, `aside_m` to the left of the direction of travel.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle

Road = tuple[str, str]
"""A road by the nodes that it connects; it has one or more lanes side by side."""

LaneIndex = tuple[str, str, int]
"""A lane: its road's nodes and its number on the road; 0 is the leftmost."""

DEFAULT_SPEED_M_S = 20.0

_PARTS = 50  # into which the turns at a road's end are divided by traffic


class Lane(ABC):
    """A lane around a middle line; no driver may change to one that is `forbidden`.

    Attributes:
        length: length of the middle line, m.
        tightest_m: least radius of its bends, infinite where there are none.
    """

    length: float
    tightest_m: float

    def __init__(self, width: float, speed_limit: float, forbidden: bool) -> None:
        self.width, self.speed_limit, self.forbidden = width, speed_limit, forbidden

    def position(self, along_m: float, aside_m: float) -> Floats:
        """Return a place (2,) m in the world."""
        place: Floats = self.positions(np.array([along_m]), aside_m)[0]
        return place

    @abstractmethod
    def positions(self, along_m: Floats, aside_m: float) -> Floats:
        """Return places (N, 2) m in the world at distances (N,) along the lane, the same as one by one."""

    @abstractmethod
    def stations(self, step_m: float) -> Floats:
        """Return distances (K,) along the lane, both ends among them, between which its middle is nearly straight.

        Arcs are divided into parts of at most `step_m`.
        """

    def widths_at(self, along_m: Floats) -> Floats:
        """Return the lane's widths (N,) m at distances (N,) along it."""
        return np.full(len(along_m), float(self.width))

    @abstractmethod
    def heading_at(self, along_m: float) -> float:
        """Return the direction of the middle line, rad."""

    def radius_at(self, along_m: float) -> float:
        """Return the radius of the bend at a distance along the lane, m."""
        return self.tightest_m

    @abstractmethod
    def local_coordinates(self, position: Floats) -> tuple[float, float]:
        """Return `along_m` and `aside_m` of a place (2,) m."""

    def contains(self, position: Floats, margin_m: float = 0.0) -> bool:
        """Return whether a place (2,) m lies within the lane's edges and a margin, up to 5 m beyond its ends."""
        along, aside = self.local_coordinates(position)
        return bool(abs(aside) <= self.width / 2 + margin_m and -5 <= along < self.length + 5)


class StraightLane(Lane):
    """A lane from one point (2,) m to another."""

    tightest_m = np.inf

    def __init__(
        self,
        start: ArrayLike,
        end: ArrayLike,
        width: float = 4.0,
        speed_limit: float = DEFAULT_SPEED_M_S,
        forbidden: bool = False,
    ) -> None:
        super().__init__(width, speed_limit, forbidden)
        self.start, self.end = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
        offset = self.end - self.start
        self.heading = float(exact.arctan2(offset[1], offset[0]))
        self.length = float(exact.norm(offset))
        self.direction: Floats = offset / self.length
        self._left = np.array([-self.direction[1], self.direction[0]])

    def position(self, along_m: float, aside_m: float) -> Floats:  # a town asks for thousands
        return np.asarray(self.start + along_m * self.direction + aside_m * self._left)

    def positions(self, along_m: Floats, aside_m: float) -> Floats:
        return np.asarray(self.start + along_m[:, None] * self.direction + aside_m * self._left)

    def stations(self, step_m: float) -> Floats:
        return np.linspace(0.0, self.length, 2)

    def heading_at(self, along_m: float) -> float:
        return self.heading

    def local_coordinates(self, position: Floats) -> tuple[float, float]:
        offset = position - self.start
        return float(exact.dot(offset, self.direction)), float(exact.dot(offset, self._left))


class CircularLane(Lane):
    """A lane along an arc of at most half a turn, from `start_phase` to `end_phase` (rad) around `center` (2,) m.

    It bends to the left if the angle grows, else to the right; `turn` is 1 or -1 accordingly.
    """

    def __init__(
        self,
        center: ArrayLike,
        radius: float,
        start_phase: float,
        end_phase: float,
        width: float = 4.0,
        speed_limit: float = DEFAULT_SPEED_M_S,
        forbidden: bool = False,
    ) -> None:
        super().__init__(width, speed_limit, forbidden)
        self.center = np.array(center, dtype=np.float64)
        self.radius, self.start_phase, self.end_phase = radius, start_phase, end_phase
        self.tightest_m = float(radius)
        self.turn = 1 if end_phase > start_phase else -1
        self.length = radius * (end_phase - start_phase) * self.turn

    def positions(self, along_m: Floats, aside_m: float) -> Floats:
        phase = self.turn * along_m / self.radius + self.start_phase
        ray = np.stack([exact.cos(phase), exact.sin(phase)], axis=1)
        return np.asarray(self.center + (self.radius - aside_m * self.turn) * ray)

    def stations(self, step_m: float) -> Floats:
        return np.linspace(0.0, self.length, max(2, int(np.ceil(self.length / step_m)) + 1))

    def heading_at(self, along_m: float) -> float:
        return self.turn * along_m / self.radius + self.start_phase + np.pi / 2 * self.turn

    def local_coordinates(self, position: Floats) -> tuple[float, float]:
        offset = position - self.center
        # Adding and subtracting the start phase rounds as highway-env does.
        phase = self.start_phase + wrap_angle(exact.arctan2(offset[1], offset[0]) - self.start_phase)
        along = self.turn * (phase - self.start_phase) * self.radius
        return float(along), float(self.turn * (self.radius - exact.norm(offset)))


class RoadNetwork:
    """Lanes by road, in the order in which they were added.

    Attributes:
        graph: lanes by the nodes that a road leads from and to.
        traffic_per_h: vehicles in an hour on roads, where it is known.
    """

    def __init__(self) -> None:
        self.graph: dict[str, dict[str, list[Lane]]] = {}
        self.traffic_per_h: dict[Road, float] = {}

    def add_lane(self, start: str, end: str, lane: Lane) -> None:
        """Add a lane to the road between two nodes, to the right of the lanes that it has."""
        self.graph.setdefault(start, {}).setdefault(end, []).append(lane)

    def get_lane(self, index: LaneIndex) -> Lane:
        """Return a lane."""
        start, end, number = index
        return self.graph[start][end][number]

    @property
    def lanes(self) -> Mapping[LaneIndex, Lane]:
        """All lanes, by the roads' start nodes, end nodes and numbers."""
        return {
            (start, end, number): lane
            for start, ends in self.graph.items()
            for end, lanes in ends.items()
            for number, lane in enumerate(lanes)
        }

    def by_traffic(self, roads: Sequence[Road]) -> list[Road]:
        """Return each road as often as its traffic asks, of 50 times; all at least once, and once without traffic."""
        traffic = [self.traffic_per_h.get(road, 0.0) for road in roads]
        parts = _PARTS / (sum(traffic) or np.inf)
        return [road for road, each in zip(roads, traffic, strict=True) for _ in range(max(1, round(parts * each)))]

    @property
    def endless(self) -> frozenset[Road]:
        """Roads from which one can drive on without end."""
        roads = [(start, end) for start in self.graph for end in self.graph[start]]
        onward = {road: [(road[1], to) for to in self.graph.get(road[1], ())] for road in roads}
        kept = set(onward)
        while ended := {road for road in kept if not any(way in kept for way in onward[road])}:
            kept -= ended
        return frozenset(kept)
