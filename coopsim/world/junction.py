"""Right of way where roads meet: first come, first served, by movements that do not cross."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from highway_env.road.lane import AbstractLane
from highway_env.road.road import RoadNetwork
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats

Road = tuple[str, str]
"""A lane index without the lane's number."""

REQUEST_M = 32.0
"""From this distance to the stop line on, a vehicle asks."""

ROOM_M = 9.0
"""Free length needed behind the last vehicle on the exit: nobody waits on the crossing."""

SLOW_M_S = 3.0
"""Who leaves the exit faster than this makes room in time."""

EXIT_HALF_WIDTH_M = 2.5

COMMIT_M = 10.0
"""Who gives way to a movement with priority can still stop if it is farther than this from the line."""

FIRST, USUAL, YIELDS = 1, 0, -1
"""Roles of movements. Users of the first wait only for who is on their way already, and the usual go as they come; who
yields loses the grant to the first, up to where one commits oneself."""

_CLEARANCE_M = 4.2  # middle lines of two movements closer than this: vehicles on both would touch


class Traveller(Protocol):
    """What the junction needs to know of a vehicle."""

    position: Floats
    speed: float
    LENGTH: float

    def upcoming(self) -> list[tuple[Road, AbstractLane, float]]:
        """Roads ahead on the planned route: index, lane, and distance (m) from here to its start (<= 0: on it)."""


class Junction:
    """Grants movements.

    A vehicle that is granted keeps its grant until it has left; one that is not treats the stop line as an obstacle.
    Who asked first goes first, and whoever would cross somebody that waits longer waits too, so nobody starves.
    A vehicle bars a movement only until its tail is past the place where the two come close.

    Args:
        network: the roads.
        roads: the movements over the junction, each from a stop line to an exit.
        priority: those of them to which others give way.
    """

    def __init__(self, network: RoadNetwork, roads: Sequence[Road], priority: Sequence[Road] = ()) -> None:
        self._roads = {road: k for k, road in enumerate(roads)}
        self._clear_m = clearances(network, roads)
        self._role = roles(self._clear_m, [road in priority for road in roads])
        self._queue: dict[Traveller, int] = {}  # in the order of asking
        self._granted: dict[Traveller, int] = {}

    def update(self, vehicles: Sequence[Traveller], commanded: Sequence[Traveller]) -> None:
        """Renew the grants; `commanded` vehicles obey nobody, so what they are about to do counts as granted."""
        asking: dict[Traveller, int] = {}
        tail_m: dict[Traveller, float] = {}  # along its movement
        going: set[Traveller] = set()
        for vehicle in vehicles:
            movement, distance_m = self._movement(vehicle)
            if movement is None:
                continue
            if distance_m < REQUEST_M:
                if distance_m <= 0:
                    going.add(vehicle)
                elif self._role[movement] == YIELDS and distance_m > COMMIT_M:
                    self._granted.pop(vehicle, None)
                asking[vehicle] = movement
                tail_m[vehicle] = -distance_m - vehicle.LENGTH / 2
        self._granted = {
            vehicle: movement for vehicle, movement in self._granted.items() if asking.get(vehicle) == movement
        }
        # Whoever is on the junction already is a fact, however it got there.
        self._granted |= {vehicle: asking[vehicle] for vehicle in going}
        self._granted |= {vehicle: asking[vehicle] for vehicle in commanded if vehicle in asking}
        order = [*(vehicle for vehicle in self._queue if vehicle in asking), *asking]
        self._queue = {vehicle: asking[vehicle] for vehicle in order if vehicle not in self._granted}
        barring = dict(self._granted)
        for vehicle, movement in list(self._queue.items()):
            first = self._role[movement] == FIRST
            ahead = self._granted if first else barring
            barred = any(tail_m[other] < self._clear_m[movement, way] for other, way in ahead.items())
            barring[vehicle] = movement
            if self._role[movement] == YIELDS:
                barred |= any(self._passes(other, movement) for other in vehicles if self._goes(other))
            if not barred and (first or self._room(vehicle, vehicles)):
                self._granted[vehicle] = movement
                del self._queue[vehicle]

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

    def _room(self, vehicle: Traveller, vehicles: Sequence[Traveller]) -> bool:
        """Whether the exit that a vehicle wants has room for it."""
        ahead = vehicle.upcoming()
        k = next(k for k, (road, _, _) in enumerate(ahead) if road in self._roads)
        if k + 1 >= len(ahead):
            return True
        lane = ahead[k + 1][1]
        for other in vehicles:
            if other is vehicle or other.speed > SLOW_M_S:
                continue
            along, aside = lane.local_coordinates(other.position)
            if -2.0 < along < ROOM_M + (vehicle.LENGTH + other.LENGTH) / 2 and abs(aside) < EXIT_HALF_WIDTH_M:
                return False
        return True


def roles(clear_m: Floats, first: Sequence[bool]) -> NDArray[np.int64]:
    """(K,) the roles of movements of which `first` have priority, by their clearances (K, K)."""
    has_priority = np.array(first, dtype=np.bool_)
    yields = (np.isfinite(clear_m) & has_priority).any(axis=1)
    role: NDArray[np.int64] = np.where(has_priority, FIRST, np.where(yields, YIELDS, USUAL))
    return role


def clearances(network: RoadNetwork, roads: Sequence[Road]) -> Floats:
    """(K, K) m: how far along movement b its last place near movement a is; -inf: none, or both start at one line."""
    lines = [_middle_line(network.get_lane((*road, 0))) for road in roads]
    clear_m = np.full((len(roads), len(roads)), -np.inf)
    for a in range(len(roads)):
        for b in range(len(roads)):
            gap_m = np.linalg.norm(lines[a][:, None] - lines[b], axis=2).min(axis=0)
            near = np.flatnonzero(gap_m < _CLEARANCE_M)
            if len(near) and roads[a][0] != roads[b][0]:
                clear_m[a, b] = near[-1] / (len(lines[b]) - 1) * network.get_lane((*roads[b], 0)).length
    return clear_m


def _middle_line(lane: AbstractLane) -> Floats:
    """(K, 2) points about half a metre apart."""
    return np.array([lane.position(s, 0.0) for s in np.linspace(0.0, lane.length, int(2 * lane.length) + 2)])
