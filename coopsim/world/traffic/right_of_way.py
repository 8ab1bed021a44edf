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

Between curved movements, as maps have them, a lane may be too short to stop in. Vehicles then ask for the movement
behind it together with the one before it. They bar others until their tail has left a curved movement.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic.asked import AT_ONCE, GRANTED, LOST, is_short, line_ahead, movements_of_all
from coopsim.world.traffic.fleet import CHAUFFEURED, PARKED, UNYIELDING, Vehicle
from coopsim.world.traffic.lane_geometry import local_coordinates
from coopsim.world.traffic.lanes import POLYLINE, LaneArrays
from coopsim.world.traffic.movements import FIRST, YIELDS, Movements
from coopsim.world.traffic.routes import lane_of_route, plan_ahead, start_of_route
from coopsim.world.traffic.rules import LONG_M, STANDING_M_S

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


@njit(cache=True, nogil=True)
def grant(network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements) -> None:
    """Renew `movement` and `ticket` of all vehicles."""
    line_m, node = np.empty(len(rows)), np.empty(len(rows), np.int64)
    for i in range(len(rows)):
        plan_ahead(network, rows[i], routes[i])
        line_m[i], node[i] = _ask(network, rows[i], routes[i], movements)
    asked, tail_m, last, role = movements_of_all(network, rows, routes, movements)
    held, short = _revoke(network, rows, routes, movements, (line_m, node), last, role)
    _number_new_askers(rows)
    waiting = _in_order(rows)
    _serve_nearest_first(rows, waiting, line_m, node)
    before = [i for i in range(len(rows)) if rows[i].ticket == GRANTED]
    for i in waiting:
        first, clears, closed = role[i] == FIRST, False, False
        for movement in asked[i, 1:]:
            if movement >= 0:
                clears |= movements.clears[movement]
                closed |= movements.closed[movement]
        if closed:
            continue
        leads = _leads(rows, waiting, line_m, node, i)
        ahead = [k for k in before if not ((first and rows[k].ticket > GRANTED) or (leads and held[k]))]
        barred = _is_barred(rows, ahead, asked, tail_m, movements, i)
        before.append(i)
        for movement in asked[i, 1:]:
            if movement >= 0 and movements.role[movement] == YIELDS:
                barred |= _must_give_way(network, rows, routes, movements, held, role, i, movement)
        has_way = first and not clears
        if not barred and not held[i] and (has_way or _has_space(network, rows, routes, movements, last, i)):
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
def request_m(vehicle: Vehicle, movements: Movements) -> float:
    """Return the distance to a stop line from which on a vehicle asks, m."""
    return max(REQUEST_M, min(vehicle.speed**2 / (2 * movements.braking_m_s2), _FARTHEST_REQUEST_M))


@njit(cache=True, nogil=True)
def _ask(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements) -> tuple[float, int]:
    """Note what a vehicle asks for, and grant what needs no asking.

    Return the distance (m) to its stop line, which is <= 0 where it is on its movement, and the node there; -inf and -1
    where it asks for nothing.
    """
    if vehicle.driver == PARKED:
        return -np.inf, -1
    if vehicle.astray:
        vehicle.movement, vehicle.ticket, vehicle.left = -1, -1, 0
        return -np.inf, -1
    k, distance_m = line_ahead(network, vehicle, route, movements.of_road)
    was = vehicle.movement if vehicle.ticket == GRANTED else -1
    left = was >= 0 and (k < 0 or movements.of_road[route[k, 0]] != was)
    if left and network.lanes[network.roads[movements.road[was]].first_lane].kind == POLYLINE:
        vehicle.left = was + 1
    if k < 0 or distance_m >= request_m(vehicle, movements):
        vehicle.movement, vehicle.ticket = -1, -1
        return -np.inf, -1
    movement = movements.of_road[route[k, 0]]
    on_short = k == 1 and is_short(network, vehicle, route[0, 0], movements.back_m[movement])
    if movement != vehicle.movement:
        kept = on_short or (k == 0 and network.lanes[network.roads[route[0, 0]].first_lane].kind == POLYLINE)
        vehicle.movement, vehicle.ticket = movement, GRANTED if was >= 0 and kept else -1
    if movements.role[movement] == YIELDS and distance_m > COMMIT_M and vehicle.ticket == GRANTED and not on_short:
        vehicle.ticket = LOST
    # A vehicle on the junction is a fact, however it got there; others obey no rule.
    if distance_m <= 0 or vehicle.driver in (CHAUFFEURED, UNYIELDING):
        vehicle.ticket = GRANTED
    return distance_m, network.roads[route[k, 0]].start


@njit(cache=True, nogil=True)
def _revoke(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movements: Movements,
    lines: tuple[Floats, Ints],
    last: Ints,
    role: Ints,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Revoke grants that cannot be used; those vehicles keep their place before all waiting ones.

    Return masks (N,): vehicles that wait for space behind the junction, those in line behind them, those behind one
    that waits at another line, and those with priority that are in line behind one that gives way; and the first of
    these alone.
    """
    line_m, node = lines
    held, short = np.zeros(len(rows), dtype=np.bool_), np.zeros(len(rows), dtype=np.bool_)
    for i in range(len(rows)):
        if rows[i].movement < 0 or rows[i].ticket == GRANTED or role[i] == FIRST:
            continue
        short[i] = not _has_space(network, rows, routes, movements, last, i)
        forks = network.lanes[rows[i].target_lane].kind == POLYLINE
        for other in range(len(rows)):
            if node[other] == node[i] and line_m[other] >= line_m[i]:
                held[other] |= short[i] or role[other] == FIRST
            elif forks and node[other] >= 0 and node[other] != node[i] and line_m[other] > 0:
                held[other] |= _is_behind(network, rows[other], routes[other], movements, rows[i])
    may = held & (rows["ticket"] == GRANTED) & (line_m > 0)
    may &= (rows["driver"] != CHAUFFEURED) & (rows["driver"] != UNYIELDING)
    may |= rows["ticket"] == LOST
    revoked = [i for i in np.argsort(line_m) if may[i]]
    for i in range(len(rows)):
        if rows[i].ticket > GRANTED:
            rows[i].ticket += len(revoked)
    for place in range(len(revoked)):
        rows[revoked[place]].ticket = GRANTED + 1 + place
    return held, short


@njit(cache=True, nogil=True)
def _is_behind(network: LaneArrays, vehicle: Vehicle, route: Ints, movements: Movements, ahead: Vehicle) -> bool:
    """Return whether another vehicle is ahead of one before its line: a curved lane may fork before the lines."""
    lane = network.lanes[ahead.target_lane]
    for k in range(vehicle.route_length):
        if movements.of_road[route[k, 0]] >= 0:
            return False
        if route[k, 0] == lane.road:
            along, _ = local_coordinates(lane, network.corners, vehicle.x, vehicle.y)
            ahead_m, _ = local_coordinates(lane, network.corners, ahead.x, ahead.y)
            return k > 0 or ahead_m > along
    return False


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
def _is_barred(
    rows: NDArray[Any], ahead: list[int], asked: Ints, tail_m: Floats, movements: Movements, me: int
) -> bool:
    """Return whether a vehicle that goes before, or has a tail on a movement, has not passed a conflict with mine."""
    barred = False
    for other in range(len(rows)):
        if asked[other, 0] >= 0 and other != me:
            barred |= _is_in_conflict(rows, asked, tail_m, movements, me, other, 0)
    for other in ahead:
        for slot in range(1, AT_ONCE):
            if asked[other, slot] >= 0:
                barred |= _is_in_conflict(rows, asked, tail_m, movements, me, other, slot)
    return barred


@njit(cache=True, nogil=True)
def _is_in_conflict(
    rows: NDArray[Any], asked: Ints, tail_m: Floats, movements: Movements, me: int, other: int, slot: int
) -> bool:
    """Return whether another vehicle's movement conflicts with one of mine, and its tail is not past that place."""
    found, long = False, rows[me].length > LONG_M or rows[other].length > LONG_M
    clear_m = movements.long_clear_m if long else movements.clear_m
    for mine in asked[me, 1:]:
        found |= mine >= 0 and tail_m[other, slot] < clear_m[mine, asked[other, slot]]
    return found


@njit(cache=True, nogil=True)
def _must_give_way(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movements: Movements,
    held: NDArray[np.bool_],
    role: Ints,
    me: int,
    mine: int,
) -> bool:
    """Return whether a vehicle approaches a movement to which mine gives way, by any way, and is not past it yet."""
    yields, clear_m = movements.yields[mine], movements.clear_m[mine]
    for other in range(len(rows)):
        vehicle, route = rows[other], routes[other]
        late = vehicle.ticket > GRANTED and role[other] != FIRST
        if other == me or vehicle.driver == PARKED or vehicle.astray or held[other] or late:
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
def _has_space(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, movements: Movements, last: Ints, me: int
) -> bool:
    """Return whether the exit that a vehicle wants has space for it, and for those on their way there."""
    k = last[me]
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
        comes = other != me and rows[other].ticket == GRANTED
        comes = comes and movements.exit[movements.of_road[routes[other, last[other], 0]]] == node
        if comes or (rows[other].speed > SLOW_M_S and along_m[other] < free_m):
            need_m += rows[other].length + QUEUE_GAP_M
    return bool(free_m >= need_m)
