"""Right of way where roads meet: conflicts and roles of movements, and grants as kernels, for either engine.

A movement is a road over a junction, from stop line to exit. Vehicles ask for theirs; the first to ask goes first, and
a vehicle that would cross one that waits longer waits, too, so none starves. A vehicle with a grant keeps it until it
has left the junction; one without treats the stop line as an obstacle.

A vehicle bars a movement only until its tail is past the place where the two come close. A vehicle that waits for space
behind the junction, or in line behind such a one, does not bar those at the head of their lines: queues around a block
would wait for each other for ever. Nor does one with priority, in line behind one that gives way. A vehicle that stands
at the head of a line turns elsewhere if the exit that it wanted is full.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.places.layout import CLEARANCE_M
from coopsim.world.places.road_network import CircularLane, Lane, Road, RoadNetwork
from coopsim.world.traffic.fleet import CHAUFFEURED, PARKED, UNYIELDING, Vehicle
from coopsim.world.traffic.lanes import (
    LaneArrays,
    NumberedNetwork,
    lane_of_route,
    local_coordinates,
    plan_ahead,
    start_of_route,
)
from coopsim.world.traffic.rules import STANDING_M_S

REQUEST_M = 32.0
"""Distance to the stop line from which on a vehicle asks."""

EXIT_SPACE_M = 9.0
"""Free length needed behind the last vehicle on the exit: no vehicle waits on the junction."""

EXIT_HALF_WIDTH_M = 2.5

SLOW_M_S = 3.0
"""Vehicles that leave the exit faster than this make space in time, unless one ahead of them stands."""

QUEUE_GAP_M = 5.0
"""Gap between vehicles in a queue."""

GENTLE_M = 60.0
"""In bends of a larger radius long vehicles hardly swing out: they count as straight."""

COMMIT_M = 10.0
"""A vehicle that must give way can still stop if it is farther than this from the line."""

FIRST, USUAL, YIELDS = 1, 0, -1
"""Roles of movements. FIRST waits only for vehicles that are on their way already. USUAL goes in the order of asking.
YIELDS loses its grant to FIRST, up to `COMMIT_M`."""


def roles(clear_m: Floats, has_priority: Sequence[bool]) -> Ints:
    """Return the roles (K,) of movements, from their clearances (K, K) and which of them have priority."""
    priority = np.array(has_priority, dtype=np.bool_)
    yields = (np.isfinite(clear_m) & priority).any(axis=1)
    return np.where(priority, FIRST, np.where(yields, YIELDS, USUAL)).astype(np.int64)


def clearances(network: RoadNetwork, movements: Sequence[Road], clearance_m: float = CLEARANCE_M) -> Floats:
    """Return (K, K) m: how far along movement b its last place near movement a is.

    Infinite below zero where they do not come near, or start at the same line.
    """
    lanes = [network.get_lane((*road, 0)) for road in movements]
    if not lanes:
        return np.zeros((0, 0))
    lines = [_middle_line(lane) for lane in lanes]
    first = np.cumsum([0, *(len(line) for line in lines)])
    nodes: dict[str, int] = {}
    origin = np.array([nodes.setdefault(start, len(nodes)) for start, _ in movements])
    gentle = np.array([not isinstance(lane, CircularLane) or lane.radius > GENTLE_M for lane in lanes])
    near_m = np.where(gentle[:, None] & gentle, clearance_m, CLEARANCE_M)
    last = _last_near(np.concatenate(lines), first, origin, near_m)
    counts, length_m = np.diff(first), np.array([lane.length for lane in lanes])
    clear_m: Floats = np.where(last >= 0, last / (counts - 1) * length_m, -np.inf)
    return clear_m


@njit(cache=True, nogil=True)
def _last_near(points: Floats, first: Ints, origin: Ints, near_m: Floats) -> Ints:
    """Return (K, K) the number of line b's last point that is near line a, -1: none, or both start at one node.

    `points` (P, 2) m are those of all lines, `first` (K + 1,) the first one of each line, and P, `origin` (K,) the
    nodes that lines start at, and `near_m` (K, K) the distances below which they are near.
    """
    count = len(origin)
    last = np.full((count, count), -1)
    low, high = np.empty((count, 2)), np.empty((count, 2))
    for k in range(count):
        for axis in range(2):
            own = points[first[k] : first[k + 1], axis]
            low[k, axis], high[k, axis] = own.min(), own.max()
    for a in range(count):
        for b in range(count):
            reach = near_m[a, b]
            apart = (low[a] - high[b] > reach).any() or (low[b] - high[a] > reach).any()
            if not apart and origin[a] != origin[b]:
                last[a, b] = _last_of(points[first[a] : first[a + 1]], points[first[b] : first[b + 1]], reach)
    return last


@njit(cache=True, nogil=True)
def _last_of(line: Floats, other: Floats, near_m: float) -> int:
    """Return the number of the last point of another line (M, 2) that is near one (N, 2), -1: none."""
    for k in range(len(other) - 1, -1, -1):
        for i in range(len(line)):
            dx, dy = line[i, 0] - other[k, 0], line[i, 1] - other[k, 1]
            if math.sqrt(dx * dx + dy * dy) < near_m:
                return k
    return -1


def _middle_line(lane: Lane) -> Floats:
    """Return points (K, 2) about half a metre apart."""
    return lane.positions(np.linspace(0.0, lane.length, int(2 * lane.length) + 2), 0.0)


GRANTED = 0
"""Ticket of a vehicle that may go. A waiting one has a ticket > 0, in the order of asking; -1: does not ask."""

_LOST = -2  # ticket of a vehicle that must give way, had a grant and asks again: it keeps its place


class Movements(NamedTuple):
    """The K movements of a place.

    Attributes:
        of_road: (R,) number of the movement that a road is, -1: none.
        clear_m: (K, K) m, see `clearances`.
        role: (K,) `FIRST`, `USUAL` or `YIELDS`.
        exit: (K,) node that a movement leads to.
    """

    of_road: Ints
    clear_m: Floats
    role: Ints
    exit: Ints


def movements_of(
    network: NumberedNetwork, roads: Sequence[Road], priority: Sequence[Road], clearance_m: float
) -> Movements:
    """Return the movements over some roads; others give way to those in `priority`. `clearance_m`: see `Layout`."""
    numbers = [network.road_number[road] for road in roads]
    of_road = np.full(len(network.road_number), -1, dtype=np.int64)
    of_road[numbers] = np.arange(len(numbers))
    clear_m = clearances(network.source, roads, clearance_m)
    exits = network.arrays.roads["end"][numbers].astype(np.int64)
    return Movements(of_road, clear_m, roles(clear_m, [road in priority for road in roads]), exits)


@njit(cache=True, nogil=True)
def grant(network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements) -> None:
    """Renew `movement` and `ticket` of all vehicles."""
    clear_m, role = movements.clear_m, movements.role
    line_m, node = np.empty(len(rows)), np.empty(len(rows), np.int64)
    for i in range(len(rows)):
        plan_ahead(network, rows[i], routes[i])
        line_m[i], node[i] = _ask(network, rows[i], routes[i], movements)
    tail_m = -line_m - rows["length"] / 2
    held, short = _revoke(network, rows, routes, movements, (line_m, node))
    _number_new_askers(rows)
    waiting = _in_order(rows)
    _serve_nearest_first(rows, waiting, line_m, node)
    before = [i for i in range(len(rows)) if rows[i].ticket == GRANTED]
    for i in waiting:
        first = role[rows[i].movement] == FIRST
        leads = _leads(rows, waiting, line_m, node, i)
        ahead = [k for k in before if not ((first and rows[k].ticket > GRANTED) or (leads and held[k]))]
        barred = _is_barred(rows, ahead, tail_m, clear_m[rows[i].movement])
        before.append(i)
        if role[rows[i].movement] == YIELDS:
            barred |= _must_give_way(network, rows, routes, movements, held, i)
        if not barred and not held[i] and (first or _has_space(network, rows, routes, movements, i)):
            rows[i].ticket = GRANTED
        elif short[i] and leads and rows[i].speed < STANDING_M_S:
            _turn_elsewhere(network, rows[i], routes[i], movements.of_road)


@njit(cache=True, nogil=True)
def _turn_elsewhere(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> None:
    """Draw other turns for a vehicle that stands at the line of a full road; it keeps its place."""
    k, _ = line_ahead(network, vehicle, route, movement_of)
    vehicle.route_length = k
    plan_ahead(network, vehicle, route)
    k, _ = line_ahead(network, vehicle, route, movement_of)
    if k >= 0:
        vehicle.movement = movement_of[route[k, 0]]


@njit(cache=True, nogil=True)
def line_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> tuple[int, float]:
    """Return the place in the route of the first movement (-1: none), and the distance (m) to its start."""
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if movement_of[route[k, 0]] >= 0:
            return k, distance_m
        distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return -1, np.inf


@njit(cache=True, nogil=True)
def _ask(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements) -> tuple[float, int]:
    """Note what a vehicle asks for, and grant what needs no asking.

    Return the distance (m) to its stop line, which is <= 0 where it is on its movement, and the node there; -inf and -1
    where it asks for nothing.
    """
    if vehicle.driver == PARKED:
        return -np.inf, -1
    k, distance_m = line_ahead(network, vehicle, route, movements.of_road)
    if k < 0 or distance_m >= REQUEST_M:
        vehicle.movement, vehicle.ticket = -1, -1
        return -np.inf, -1
    movement = movements.of_road[route[k, 0]]
    if movement != vehicle.movement:
        vehicle.movement, vehicle.ticket = movement, -1
    if movements.role[movement] == YIELDS and distance_m > COMMIT_M and vehicle.ticket == GRANTED:
        vehicle.ticket = _LOST
    # A vehicle on the junction is a fact, however it got there; others obey no rule.
    if distance_m <= 0 or vehicle.driver in (CHAUFFEURED, UNYIELDING):
        vehicle.ticket = GRANTED
    return distance_m, network.roads[route[k, 0]].start


@njit(cache=True, nogil=True)
def _revoke(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements, lines: tuple[Floats, Ints]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Revoke grants that cannot be used; those vehicles keep their place before all waiting ones.

    Return masks (N,): vehicles that wait for space behind the junction, those in line behind them, and those with
    priority that are in line behind one that gives way; and the first of these alone.
    """
    role, (line_m, node) = movements.role, lines
    held, short = np.zeros(len(rows), dtype=np.bool_), np.zeros(len(rows), dtype=np.bool_)
    for i in range(len(rows)):
        if rows[i].movement < 0 or rows[i].ticket == GRANTED or role[rows[i].movement] == FIRST:
            continue
        short[i] = not _has_space(network, rows, routes, movements, i)
        for other in range(len(rows)):
            if node[other] == node[i] and line_m[other] >= line_m[i]:
                held[other] |= short[i] or role[rows[other].movement] == FIRST
    may = held & (rows["ticket"] == GRANTED) & (line_m > 0)
    may &= (rows["driver"] != CHAUFFEURED) & (rows["driver"] != UNYIELDING)
    may |= rows["ticket"] == _LOST
    revoked = [i for i in np.argsort(line_m) if may[i]]
    for i in range(len(rows)):
        if rows[i].ticket > GRANTED:
            rows[i].ticket += len(revoked)
    for place in range(len(revoked)):
        rows[revoked[place]].ticket = GRANTED + 1 + place
    return held, short


@njit(cache=True, nogil=True)
def _number_new_askers(rows: NDArray[Any]) -> None:
    last = GRANTED
    for i in range(len(rows)):
        last = max(last, rows[i].ticket)
    for i in range(len(rows)):
        if rows[i].movement >= 0 and rows[i].ticket < GRANTED:
            last += 1
            rows[i].ticket = last


@njit(cache=True, nogil=True)
def _in_order(rows: NDArray[Any]) -> list[int]:
    """Return the waiting vehicles in the order of asking."""
    waiting = [i for i in range(len(rows)) if rows[i].ticket > GRANTED]
    for k in range(1, len(waiting)):  # insertion sort: few wait at a time
        place, i = k, waiting[k]
        while place > 0 and rows[waiting[place - 1]].ticket > rows[i].ticket:
            waiting[place] = waiting[place - 1]
            place -= 1
        waiting[place] = i
    return waiting


@njit(cache=True, nogil=True)
def _serve_nearest_first(rows: NDArray[Any], waiting: list[int], line_m: Floats, node: Ints) -> None:
    """Exchange the tickets of vehicles at one line where the farther one asked first."""
    for a in range(len(waiting)):
        for b in range(a + 1, len(waiting)):
            i, j = waiting[a], waiting[b]
            if node[i] == node[j] and line_m[i] > line_m[j]:
                rows[i].ticket, rows[j].ticket = rows[j].ticket, rows[i].ticket
                waiting[a], waiting[b] = j, i


@njit(cache=True, nogil=True)
def _leads(rows: NDArray[Any], waiting: list[int], line_m: Floats, node: Ints, me: int) -> bool:
    """Return whether no other vehicle waits at the same line before me."""
    leads = True
    for other in waiting:
        leads &= rows[other].ticket == GRANTED or node[other] != node[me] or line_m[other] >= line_m[me]
    return leads


@njit(cache=True, nogil=True)
def _is_barred(rows: NDArray[Any], ahead: list[int], tail_m: Floats, clear_m: Floats) -> bool:
    """Return whether a vehicle that goes before has not passed the conflict with a movement of clearances (K,)."""
    barred = False
    for other in ahead:
        barred |= tail_m[other] < clear_m[rows[other].movement]
    return barred


@njit(cache=True, nogil=True)
def _must_give_way(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements, held: NDArray[np.bool_], me: int
) -> bool:
    """Return whether a vehicle approaches a conflicting movement with priority, by any way, and is not past it yet."""
    role, clear_m = movements.role, movements.clear_m[rows[me].movement]
    for other in range(len(rows)):
        vehicle, route = rows[other], routes[other]
        if vehicle.driver == PARKED or held[other] or (vehicle.ticket > GRANTED and role[vehicle.movement] != FIRST):
            continue
        distance_m = start_of_route(network, vehicle, route)
        for k in range(vehicle.route_length):
            movement = movements.of_road[route[k, 0]]
            first = movement >= 0 and distance_m < REQUEST_M and role[movement] == FIRST
            if first and -distance_m - vehicle.length / 2 < clear_m[movement]:
                return True
            distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return False


@njit(cache=True, nogil=True)
def _has_space(network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements, me: int) -> bool:
    """Return whether the exit that a vehicle wants has space for it, and for those on their way there."""
    k, _ = line_ahead(network, rows[me], routes[me], movements.of_road)
    if k + 1 >= rows[me].route_length:
        return True
    lane = network.lanes[lane_of_route(network, rows[me], routes[me], k + 1)]
    node = network.roads[routes[me, k + 1, 0]].start
    along_m, free_m = np.full(len(rows), np.inf), np.inf
    for other in range(len(rows)):
        along, aside = local_coordinates(lane, rows[other].x, rows[other].y)
        if other != me and -2.0 < along < lane.length and abs(aside) < EXIT_HALF_WIDTH_M:
            along_m[other] = along
            if rows[other].speed <= SLOW_M_S:
                free_m = min(free_m, along - rows[other].length / 2)
    if free_m == np.inf:
        return True
    need_m = EXIT_SPACE_M + rows[me].length / 2
    for other in range(len(rows)):
        comes = other != me and rows[other].ticket == GRANTED and movements.exit[rows[other].movement] == node
        if comes or (rows[other].speed > SLOW_M_S and along_m[other] < free_m):
            need_m += rows[other].length + QUEUE_GAP_M
    return bool(free_m >= need_m)
