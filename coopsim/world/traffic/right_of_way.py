"""Right of way where roads meet: grants as kernels, for either engine.

A movement is a road over a junction, from stop line to exit. Vehicles ask for theirs; the first to ask goes first, and
a vehicle that would cross one that waits longer waits, too, so none starves. A vehicle with a grant keeps it until it
has left the junction; one without treats the stop line as an obstacle.

A vehicle bars a movement only until its tail is past the place where the two come close. A vehicle that waits for space
behind the junction, or in line behind such a one, does not bar those at the head of their lines: queues around a block
would wait for each other for ever. Nor does one with priority, in line behind one that gives way. A vehicle that stands
at the head of a line turns elsewhere if the exit that it wanted is full.

At a red or yellow light nobody is granted, and nobody who waits there bars others. A vehicle that can still brake loses
its grant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic.fleet import CHAUFFEURED, PARKED, UNYIELDING, Vehicle
from coopsim.world.traffic.lane_geometry import local_coordinates
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.movements import FIRST, YIELDS, Movements
from coopsim.world.traffic.routes import lane_of_route, plan_ahead, start_of_route
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

COMMIT_M = 10.0
"""A vehicle that must give way can still stop if it is farther than this from the line."""

_FARTHEST_REQUEST_M = 60.0
_STOPPING_M_S2, _BEFORE_LINE_M = 4.0, 2.0  # braking for a light, and where the middle of a vehicle would then stand

GRANTED = 0
"""Ticket of a vehicle that may go. A waiting one has a ticket > 0, in the order of asking; -1: does not ask."""

_CRAWLING_M_S = 3.0  # slower vehicles stop even where they stand beyond the line

_LOST = -2  # ticket of a vehicle that must give way, had a grant and asks again: it keeps its place


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
        if movements.closed[rows[i].movement]:
            continue
        has_way = first and not movements.clears[rows[i].movement]
        leads = _leads(rows, waiting, line_m, node, i)
        ahead = [k for k in before if not ((first and rows[k].ticket > GRANTED) or (leads and held[k]))]
        barred = _is_barred(rows, ahead, tail_m, clear_m[rows[i].movement])
        before.append(i)
        if role[rows[i].movement] == YIELDS:
            barred |= _must_give_way(network, rows, routes, movements, held, i)
        if not barred and not held[i] and (has_way or _has_space(network, rows, routes, movements, i)):
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
def request_m(vehicle: Vehicle, movements: Movements) -> float:
    """Return the distance to a stop line from which on a vehicle asks, m."""
    return max(REQUEST_M, min(vehicle.speed**2 / (2 * movements.braking_m_s2), _FARTHEST_REQUEST_M))


@njit(cache=True, nogil=True)
def can_stop(vehicle: Vehicle, line_m: float) -> bool:
    """Return whether a vehicle can stop for a light that turns yellow, at a distance to its line (m)."""
    before_m = _BEFORE_LINE_M * min(vehicle.speed / _CRAWLING_M_S, 1.0)  # one that stands at the line stays there
    return line_m > before_m + vehicle.speed**2 / (2 * _STOPPING_M_S2)


@njit(cache=True, nogil=True)
def _ask(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements) -> tuple[float, int]:
    """Note what a vehicle asks for, and grant what needs no asking.

    Return the distance (m) to its stop line, which is <= 0 where it is on its movement, and the node there; -inf and -1
    where it asks for nothing.
    """
    if vehicle.driver == PARKED:
        return -np.inf, -1
    k, distance_m = line_ahead(network, vehicle, route, movements.of_road)
    if k < 0 or distance_m >= request_m(vehicle, movements):
        vehicle.movement, vehicle.ticket = -1, -1
        return -np.inf, -1
    movement = movements.of_road[route[k, 0]]
    if movement != vehicle.movement:
        vehicle.movement, vehicle.ticket = movement, -1
    if movements.role[movement] == YIELDS and distance_m > COMMIT_M and vehicle.ticket == GRANTED:
        vehicle.ticket = _LOST
    if movements.closed[movement] and vehicle.ticket == GRANTED and can_stop(vehicle, distance_m):
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
    mine, role = rows[me].movement, movements.role
    yields, clear_m = movements.yields[mine], movements.clear_m[mine]
    for other in range(len(rows)):
        vehicle, route = rows[other], routes[other]
        if vehicle.driver == PARKED or held[other] or (vehicle.ticket > GRANTED and role[vehicle.movement] != FIRST):
            continue
        distance_m = start_of_route(network, vehicle, route)
        for k in range(vehicle.route_length):
            movement = movements.of_road[route[k, 0]]
            first = movement >= 0 and yields[movement] and distance_m < request_m(vehicle, movements)
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
        along, aside = local_coordinates(lane, network.corners, rows[other].x, rows[other].y)
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
