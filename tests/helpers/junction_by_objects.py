"""A second implementation of right of way, over objects, to check the kernels against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import Lane, Road, RoadNetwork
from coopsim.world.traffic.movements import FIRST, YIELDS, clearances, roles
from coopsim.world.traffic.right_of_way import (
    COMMIT_M,
    EXIT_HALF_WIDTH_M,
    EXIT_SPACE_M,
    QUEUE_GAP_M,
    REQUEST_M,
    SLOW_M_S,
)
from coopsim.world.traffic.rules import STANDING_M_S


class Traveller(Protocol):
    """A vehicle as the junction sees it."""

    position: Floats
    speed: float
    LENGTH: float

    def upcoming(self) -> list[tuple[Road, Lane, float]]:
        """Return the planned roads: index, lane, and distance (m) from here to its start (<= 0: on it)."""

    def choose_again(self, place: int) -> None:
        """Draw other turns from that place in the route on."""


class Junction:
    """Grants movements.

    A vehicle with a grant keeps it until it has left; one without treats the stop line as an obstacle.

    Args:
        network: the roads.
        roads: the movements.
        priority: movements to which others give way.
        clearance_m: see `Layout`.
    """

    def __init__(
        self,
        network: RoadNetwork,
        roads: Sequence[Road],
        priority: Sequence[Road] = (),
        clearance_m: float = CLEARANCE_M,
    ) -> None:
        self._roads = {road: k for k, road in enumerate(roads)}
        self._starts, self._ends = ([road[k] for road in roads] for k in (0, 1))
        self._clear_m = clearances(network, roads, clearance_m)
        self._role = roles(self._clear_m, [road in priority for road in roads])
        self._queue: dict[Traveller, int] = {}  # in the order of asking
        self._granted: dict[Traveller, int] = {}

    def update(self, vehicles: Sequence[Traveller], commanded: Sequence[Traveller]) -> None:
        """Renew the grants; `commanded` vehicles obey no rule, so their movements count as granted."""
        asking: dict[Traveller, int] = {}
        line_m: dict[Traveller, float] = {}
        lost: set[Traveller] = set()
        for vehicle in vehicles:
            movement, distance_m = self._movement(vehicle)
            if movement is None or distance_m >= REQUEST_M:
                continue
            asking[vehicle], line_m[vehicle] = movement, distance_m
            if self._role[movement] == YIELDS and distance_m > COMMIT_M and self._granted.get(vehicle) == movement:
                lost.add(vehicle)
        self._granted = {
            vehicle: movement
            for vehicle, movement in self._granted.items()
            if asking.get(vehicle) == movement and vehicle not in lost
        }
        # A vehicle on the junction is a fact, however it got there.
        fixed = {vehicle for vehicle in asking if line_m[vehicle] <= 0 or vehicle in commanded}
        self._granted |= {vehicle: asking[vehicle] for vehicle in asking if vehicle in fixed}
        held, short = self._held(asking, line_m, vehicles)
        revoked = sorted((held & set(self._granted) | lost) - fixed, key=lambda vehicle: line_m[vehicle])
        for vehicle in revoked:  # they keep their place before all waiting ones
            self._granted.pop(vehicle, None)
        order = [*revoked, *(vehicle for vehicle in self._queue if vehicle in asking), *asking]
        waiting = list(dict.fromkeys(vehicle for vehicle in order if vehicle not in self._granted))
        self._serve_nearest_first(waiting, asking, line_m)
        self._queue = {vehicle: asking[vehicle] for vehicle in waiting}
        self._grant(vehicles, line_m, held, short)

    def _held(
        self, asking: Mapping[Traveller, int], line_m: Mapping[Traveller, float], vehicles: Sequence[Traveller]
    ) -> tuple[set[Traveller], set[Traveller]]:
        """Return vehicles that cannot use a grant.

        Returns:
            Vehicles that wait for space behind the junction, those in line behind them, and those with priority in line
            behind one that gives way; and the first of these alone.
        """
        held: set[Traveller] = set()
        short: set[Traveller] = set()
        for other, way in asking.items():
            if other in self._granted or self._role[way] == FIRST:
                continue
            if not self._has_space(other, vehicles):
                short.add(other)
            held |= {
                vehicle
                for vehicle, movement in asking.items()
                if self._starts[movement] == self._starts[way] and line_m[vehicle] >= line_m[other]
                if other in short or self._role[movement] == FIRST
            }
        return held, short

    def _serve_nearest_first(
        self, waiting: list[Traveller], asking: Mapping[Traveller, int], line_m: Mapping[Traveller, float]
    ) -> None:
        """Exchange the places of vehicles at one line where the farther one asked first."""
        for a, b in combinations(range(len(waiting)), 2):
            before, after = waiting[a], waiting[b]
            same = self._starts[asking[before]] == self._starts[asking[after]]
            if same and line_m[before] > line_m[after]:
                waiting[a], waiting[b] = after, before

    def _grant(
        self,
        vehicles: Sequence[Traveller],
        line_m: Mapping[Traveller, float],
        held: set[Traveller],
        short: set[Traveller],
    ) -> None:
        barring = dict(self._granted)
        tail_m = {vehicle: -distance_m - vehicle.LENGTH / 2 for vehicle, distance_m in line_m.items()}
        for vehicle, movement in list(self._queue.items()):
            first = self._role[movement] == FIRST
            leads = not any(
                self._starts[way] == self._starts[movement] and line_m[other] < line_m[vehicle]
                for other, way in self._queue.items()
            )
            ahead = self._granted if first else barring
            barred = any(
                tail_m[other] < self._clear_m[movement, way]
                for other, way in ahead.items()
                if not (leads and other in held)
            )
            barring[vehicle] = movement
            if self._role[movement] == YIELDS:
                coming = [other for other in vehicles if self._goes(other) and other not in held]
                barred |= any(self._has_way_over(other, movement) for other in coming)
            if not barred and vehicle not in held and (first or self._has_space(vehicle, vehicles)):
                self._granted[vehicle] = movement
                del self._queue[vehicle]
            elif vehicle in short and leads and vehicle.speed < STANDING_M_S:
                self._turn_elsewhere(vehicle)

    def line_m(self, vehicle: Traveller) -> float | None:
        """Return the distance to the stop line at which a vehicle has to stop; None: it may go on."""
        movement, distance_m = self._movement(vehicle)
        return distance_m if vehicle in self._queue and movement is not None and distance_m > 0 else None

    def _movement(self, vehicle: Traveller) -> tuple[int | None, float]:
        for road, _, distance_m in vehicle.upcoming():
            if road in self._roads:
                return self._roads[road], distance_m
        return None, np.inf

    def _goes(self, vehicle: Traveller) -> bool:
        """Return whether a vehicle does not have to give way at its next line."""
        return vehicle not in self._queue or self._role[self._queue[vehicle]] == FIRST

    def _has_way_over(self, vehicle: Traveller, yielding: int) -> bool:
        """Return whether a vehicle approaches a movement with priority over another, and is not past it yet."""
        for road, _, distance_m in vehicle.upcoming():
            movement = self._roads.get(road)
            first = movement is not None and distance_m < REQUEST_M and self._role[movement] == FIRST
            if first and -distance_m - vehicle.LENGTH / 2 < self._clear_m[yielding, movement]:
                return True
        return False

    def _turn_elsewhere(self, vehicle: Traveller) -> None:
        """Draw other turns for a vehicle that stands at the line of a full road; it keeps its place."""
        place = next(k for k, (road, _, _) in enumerate(vehicle.upcoming()) if road in self._roads)
        vehicle.choose_again(place)
        chosen, _ = self._movement(vehicle)
        if chosen is not None:
            self._queue[vehicle] = chosen

    def _has_space(self, vehicle: Traveller, vehicles: Sequence[Traveller]) -> bool:
        """Return whether the exit that a vehicle wants has space for it, and for those on their way there."""
        ahead = vehicle.upcoming()
        k = next(k for k, (road, _, _) in enumerate(ahead) if road in self._roads)
        if k + 1 >= len(ahead):
            return True
        (start, _), lane, _ = ahead[k + 1]
        on_exit = [
            (other, along)
            for other in vehicles
            if other is not vehicle
            for along, aside in (lane.local_coordinates(other.position),)
            if -2.0 < along < lane.length and abs(aside) < EXIT_HALF_WIDTH_M
        ]
        free_m = min((along - other.LENGTH / 2 for other, along in on_exit if other.speed <= SLOW_M_S), default=np.inf)
        before = [other for other, along in on_exit if other.speed > SLOW_M_S and along < free_m]
        before += [
            other
            for other, way in self._granted.items()
            if other is not vehicle and other not in before and self._ends[way] == start
        ]
        queue_m = sum(other.LENGTH + QUEUE_GAP_M for other in before)
        return bool(free_m >= EXIT_SPACE_M + vehicle.LENGTH / 2 + queue_m)
