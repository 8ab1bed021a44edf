"""Right of way where roads meet: first come, first served, by movements that do not cross."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Protocol

import numpy as np
from highway_env.road.lane import AbstractLane, StraightLane
from highway_env.road.road import RoadNetwork
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import CLEARANCE_M, Road

REQUEST_M = 32.0
"""From this distance to the stop line on, a vehicle asks."""

ROOM_M = 9.0
"""Free length needed behind the last vehicle on the exit: nobody waits on the crossing."""

SLOW_M_S = 3.0
"""Who leaves the exit faster than this makes room in time, unless somebody stands there."""

STANDING_M_S = 0.5
"""Who is slower than this stands."""

QUEUE_GAP_M = 5.0
"""Between two who stand in line."""

EXIT_HALF_WIDTH_M = 2.5

COMMIT_M = 10.0
"""Who gives way to a movement with priority can still stop if it is farther than this from the line."""

FIRST, USUAL, YIELDS = 1, 0, -1
"""Roles of movements. Users of the first wait only for who is on their way already, and the usual go as they come; who
yields loses the grant to the first, up to where one commits oneself."""


class Traveller(Protocol):
    """What the junction needs to know of a vehicle."""

    position: Floats
    speed: float
    LENGTH: float

    def upcoming(self) -> list[tuple[Road, AbstractLane, float]]:
        """Roads ahead on the planned route: index, lane, and distance (m) from here to its start (<= 0: on it)."""

    def choose_again(self, place: int) -> None:
        """Draw other turns from that place in the route on."""


class Junction:
    """Grants movements.

    A vehicle that is granted keeps its grant until it has left; one that is not treats the stop line as an obstacle.
    Who asked first goes first, and whoever would cross somebody that waits longer waits too, so nobody starves.
    A vehicle bars a movement only until its tail is past the place where the two come close. Who waits for room behind
    the junction, or in line behind such a one, does not bar those at the head of their lines: queues around a block
    would wait for each other for ever. Nor does who has priority, in line behind one who gives way. And who stands at
    the head of a line turns elsewhere if there is no room where it wanted to go.

    Args:
        network: the roads.
        roads: the movements over the junction, each from a stop line to an exit.
        priority: those of them to which others give way.
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
        """Renew the grants; `commanded` vehicles obey nobody, so what they are about to do counts as granted."""
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
        # Whoever is on the junction already is a fact, however it got there.
        fixed = {vehicle for vehicle in asking if line_m[vehicle] <= 0 or vehicle in commanded}
        self._granted |= {vehicle: asking[vehicle] for vehicle in asking if vehicle in fixed}
        held, short = self._held(asking, line_m, vehicles)
        revoked = sorted((held & set(self._granted) | lost) - fixed, key=lambda vehicle: line_m[vehicle])
        for vehicle in revoked:  # and they keep their place before all who wait
            self._granted.pop(vehicle, None)
        order = [*revoked, *(vehicle for vehicle in self._queue if vehicle in asking), *asking]
        waiting = list(dict.fromkeys(vehicle for vehicle in order if vehicle not in self._granted))
        self._serve_nearest_first(waiting, asking, line_m)
        self._queue = {vehicle: asking[vehicle] for vehicle in waiting}
        self._grant(vehicles, line_m, held, short)

    def _held(
        self, asking: Mapping[Traveller, int], line_m: Mapping[Traveller, float], vehicles: Sequence[Traveller]
    ) -> tuple[set[Traveller], set[Traveller]]:
        """Who cannot use a grant: who waits for room, and others behind such a one, or with priority behind who yields.

        The second are the first of these alone.
        """
        held: set[Traveller] = set()
        short: set[Traveller] = set()
        for other, way in asking.items():
            if other in self._granted or self._role[way] == FIRST:
                continue
            if not self._room(other, vehicles):
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
        """Exchange the places of those who wait at one line, where who is farther from it asked first."""
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
                barred |= any(self._passes(other, movement) for other in coming)
            if not barred and vehicle not in held and (first or self._room(vehicle, vehicles)):
                self._granted[vehicle] = movement
                del self._queue[vehicle]
            elif vehicle in short and leads and vehicle.speed < STANDING_M_S:
                self._turn_elsewhere(vehicle)

    def line_m(self, vehicle: Traveller) -> float | None:
        """Distance to the stop line at which a vehicle has to stop; None: it may go on."""
        movement, distance_m = self._movement(vehicle)
        return distance_m if vehicle in self._queue and movement is not None and distance_m > 0 else None

    def _movement(self, vehicle: Traveller) -> tuple[int | None, float]:
        for road, _, distance_m in vehicle.upcoming():
            if road in self._roads:
                return self._roads[road], distance_m
        return None, np.inf

    def _goes(self, vehicle: Traveller) -> bool:
        """Whether a vehicle does not have to give way at its next line."""
        return vehicle not in self._queue or self._role[self._queue[vehicle]] == FIRST

    def _passes(self, vehicle: Traveller, yielding: int) -> bool:
        """Whether a vehicle comes to a movement with priority over another, and is not past it yet."""
        for road, _, distance_m in vehicle.upcoming():
            movement = self._roads.get(road)
            first = movement is not None and distance_m < REQUEST_M and self._role[movement] == FIRST
            if first and -distance_m - vehicle.LENGTH / 2 < self._clear_m[yielding, movement]:
                return True
        return False

    def _turn_elsewhere(self, vehicle: Traveller) -> None:
        """Who stands at the line of a road that is full may take another one, and keeps its place."""
        place = next(k for k, (road, _, _) in enumerate(vehicle.upcoming()) if road in self._roads)
        vehicle.choose_again(place)
        chosen, _ = self._movement(vehicle)
        if chosen is not None:
            self._queue[vehicle] = chosen

    def _room(self, vehicle: Traveller, vehicles: Sequence[Traveller]) -> bool:
        """Whether the exit that a vehicle wants has room for it, and for those who are on their way there."""
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
        return bool(free_m >= ROOM_M + vehicle.LENGTH / 2 + queue_m)


def roles(clear_m: Floats, first: Sequence[bool]) -> NDArray[np.int64]:
    """(K,) the roles of movements of which `first` have priority, by their clearances (K, K)."""
    has_priority = np.array(first, dtype=np.bool_)
    yields = (np.isfinite(clear_m) & has_priority).any(axis=1)
    role: NDArray[np.int64] = np.where(has_priority, FIRST, np.where(yields, YIELDS, USUAL))
    return role


def clearances(network: RoadNetwork, roads: Sequence[Road], clearance_m: float = CLEARANCE_M) -> Floats:
    """(K, K) m: how far along movement b its last place near movement a is; -inf: none, or both start at one line."""
    lines = [_middle_line(network.get_lane((*road, 0))) for road in roads]
    clear_m = np.full((len(roads), len(roads)), -np.inf)
    for a in range(len(roads)):
        for b in range(len(roads)):
            gap_m = np.linalg.norm(lines[a][:, None] - lines[b], axis=2).min(axis=0)
            straight = all(isinstance(network.get_lane((*roads[k], 0)), StraightLane) for k in (a, b))
            near = np.flatnonzero(gap_m < (clearance_m if straight else CLEARANCE_M))
            if len(near) and roads[a][0] != roads[b][0]:
                clear_m[a, b] = near[-1] / (len(lines[b]) - 1) * network.get_lane((*roads[b], 0)).length
    return clear_m


def _middle_line(lane: AbstractLane) -> Floats:
    """(K, 2) points about half a metre apart."""
    return np.array([lane.position(s, 0.0) for s in np.linspace(0.0, lane.length, int(2 * lane.length) + 2)])
