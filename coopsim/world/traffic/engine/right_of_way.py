"""Who may cross a junction: the rule of `coopsim.world.traffic.highway_reference.junction.Junction`, over arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, PARKED, Vehicle
from coopsim.world.traffic.engine.lanes import LaneArrays, local_coordinates
from coopsim.world.traffic.engine.routes import lane_of_route, plan_ahead, start_of_route
from coopsim.world.traffic.highway_reference.junction import (
    COMMIT_M,
    EXIT_HALF_WIDTH_M,
    FIRST,
    QUEUE_GAP_M,
    REQUEST_M,
    ROOM_M,
    SLOW_M_S,
    STANDING_M_S,
    YIELDS,
)

GRANTED = 0
"""The ticket of who may go. Who waits has one > 0, in the order of asking; -1: does not ask."""

_LOST = -2  # of who gives way, had been granted and asks again: it keeps its place


@njit(cache=True, nogil=True)
def grant(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movement_of: Ints,
    rule: tuple[Floats, Ints, Ints],
) -> None:
    """Renew `movement` and `ticket` of everybody.

    Args:
        network: the roads.
        rows: the fleet.
        routes: the fleet's.
        movement_of: (R,) number of the movement that a road is, -1 for none.
        rule: the clearances (K, K) m and roles (K,) of the movements, see
        `coopsim.world.traffic.highway_reference.junction`, and the nodes (K,)
            that they lead to.
    """
    clear_m, role, exits = rule
    line_m, node = np.empty(len(rows)), np.empty(len(rows), np.int64)
    for i in range(len(rows)):
        plan_ahead(network, rows[i], routes[i])
        line_m[i], node[i] = _ask(network, rows[i], routes[i], movement_of, role)
    tail_m = -line_m - rows["length"] / 2
    held, short = _hold(network, rows, routes, movement_of, (role, exits), (line_m, node))
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
            barred |= _is_passed(network, rows, routes, movement_of, (role, held), clear_m[rows[i].movement])
        if not barred and not held[i] and (first or _room(network, rows, routes, movement_of, exits, i)):
            rows[i].ticket = GRANTED
        elif short[i] and leads and rows[i].speed < STANDING_M_S:
            _turn_elsewhere(network, rows[i], routes[i], movement_of)


@njit(cache=True, nogil=True)
def _turn_elsewhere(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> None:
    """Who stands at the line of a road that is full may take another one, and keeps its place."""
    k, _ = line_ahead(network, vehicle, route, movement_of)
    vehicle.route_length = k
    plan_ahead(network, vehicle, route)
    k, _ = line_ahead(network, vehicle, route, movement_of)
    if k >= 0:
        vehicle.movement = movement_of[route[k, 0]]


@njit(cache=True, nogil=True)
def line_ahead(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints) -> tuple[int, float]:
    """Place in the route of the first road that is a movement (-1: none), and the distance (m) to its start."""
    distance_m = start_of_route(network, vehicle, route)
    for k in range(vehicle.route_length):
        if movement_of[route[k, 0]] >= 0:
            return k, distance_m
        distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return -1, np.inf


@njit(cache=True, nogil=True)
def _ask(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints, role: Ints) -> tuple[float, int]:
    """Note what a vehicle asks for, and what needs no asking.

    Returns:
        The distance (m) to its stop line, which is <= 0 where it is on its movement, and the node there; -inf and -1
        where it asks for nothing.
    """
    if vehicle.driver == PARKED:
        return -np.inf, -1
    k, distance_m = line_ahead(network, vehicle, route, movement_of)
    if k < 0 or distance_m >= REQUEST_M:
        vehicle.movement, vehicle.ticket = -1, -1
        return -np.inf, -1
    movement = movement_of[route[k, 0]]
    if movement != vehicle.movement:
        vehicle.movement, vehicle.ticket = movement, -1
    # Whoever is on the junction already is a fact, however it got there; who is told what to do obeys nobody.
    if role[movement] == YIELDS and distance_m > COMMIT_M and vehicle.ticket == GRANTED:
        vehicle.ticket = _LOST
    if distance_m <= 0 or vehicle.driver == CHAUFFEURED:
        vehicle.ticket = GRANTED
    return distance_m, network.roads[route[k, 0]].start


@njit(cache=True, nogil=True)
def _hold(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movement_of: Ints,
    rule: tuple[Ints, Ints],
    lines: tuple[Floats, Ints],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Take back the grants of those who cannot use them; they keep their place before all who wait.

    Returns:
        (N,) who waits for room behind the junction, who is in line behind such a one, and who has priority over others
        but is in line behind one who gives way; and (N,) the first of these alone.
    """
    (role, exits), (line_m, node) = rule, lines
    held, short = np.zeros(len(rows), dtype=np.bool_), np.zeros(len(rows), dtype=np.bool_)
    for i in range(len(rows)):
        if rows[i].movement < 0 or rows[i].ticket == GRANTED or role[rows[i].movement] == FIRST:
            continue
        short[i] = not _room(network, rows, routes, movement_of, exits, i)
        for other in range(len(rows)):
            if node[other] == node[i] and line_m[other] >= line_m[i]:
                held[other] |= short[i] or role[rows[other].movement] == FIRST
    may = held & (rows["ticket"] == GRANTED) & (line_m > 0) & (rows["driver"] != CHAUFFEURED)
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
    """Who waits, in the order of asking."""
    waiting = [i for i in range(len(rows)) if rows[i].ticket > GRANTED]
    for k in range(1, len(waiting)):  # sorting by insertion: few wait at a time
        place, i = k, waiting[k]
        while place > 0 and rows[waiting[place - 1]].ticket > rows[i].ticket:
            waiting[place] = waiting[place - 1]
            place -= 1
        waiting[place] = i
    return waiting


@njit(cache=True, nogil=True)
def _serve_nearest_first(rows: NDArray[Any], waiting: list[int], line_m: Floats, node: Ints) -> None:
    """Exchange tickets of those who wait at one line, where who is farther from it asked first."""
    for a in range(len(waiting)):
        for b in range(a + 1, len(waiting)):
            i, j = waiting[a], waiting[b]
            if node[i] == node[j] and line_m[i] > line_m[j]:
                rows[i].ticket, rows[j].ticket = rows[j].ticket, rows[i].ticket
                waiting[a], waiting[b] = j, i


@njit(cache=True, nogil=True)
def _leads(rows: NDArray[Any], waiting: list[int], line_m: Floats, node: Ints, me: int) -> bool:
    """Whether nobody waits at the same line before me."""
    leads = True
    for other in waiting:
        leads &= rows[other].ticket == GRANTED or node[other] != node[me] or line_m[other] >= line_m[me]
    return leads


@njit(cache=True, nogil=True)
def _is_barred(rows: NDArray[Any], ahead: list[int], tail_m: Floats, clear_m: Floats) -> bool:
    """Whether somebody who comes before is not past where the ways come close."""
    barred = False
    for other in ahead:
        barred |= tail_m[other] < clear_m[rows[other].movement]
    return barred


@njit(cache=True, nogil=True)
def _is_passed(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movement_of: Ints,
    rule: tuple[Ints, NDArray[np.bool_]],
    clear_m: Floats,
) -> bool:
    """Whether somebody comes to a movement with priority, over whichever other one, and is not past it yet."""
    role, held = rule
    for other in range(len(rows)):
        vehicle, route = rows[other], routes[other]
        if vehicle.driver == PARKED or held[other] or (vehicle.ticket > GRANTED and role[vehicle.movement] != FIRST):
            continue
        distance_m = start_of_route(network, vehicle, route)
        for k in range(vehicle.route_length):
            movement = movement_of[route[k, 0]]
            first = movement >= 0 and distance_m < REQUEST_M and role[movement] == FIRST
            if first and -distance_m - vehicle.length / 2 < clear_m[movement]:
                return True
            distance_m += network.lanes[lane_of_route(network, vehicle, route, k)].length
    return False


@njit(cache=True, nogil=True)
def _room(network: LaneArrays, rows: NDArray[Any], routes: Ints, movement_of: Ints, exits: Ints, me: int) -> bool:
    """Whether the exit that a vehicle wants has room for it, and for those who are on their way there."""
    k, _ = line_ahead(network, rows[me], routes[me], movement_of)
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
    need_m = ROOM_M + rows[me].length / 2
    for other in range(len(rows)):
        comes = other != me and rows[other].ticket == GRANTED and exits[rows[other].movement] == node
        if comes or (rows[other].speed > SLOW_M_S and along_m[other] < free_m):
            need_m += rows[other].length + QUEUE_GAP_M
    return bool(free_m >= need_m)
