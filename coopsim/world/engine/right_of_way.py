"""Who may cross a junction: the rule of `coopsim.world.junction.Junction`, over arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.engine.fleet import CHAUFFEURED, PARKED, Vehicle
from coopsim.world.engine.lanes import LaneArrays, local_coordinates
from coopsim.world.engine.routes import lane_of_route, plan_ahead
from coopsim.world.engine.town import start_of_route
from coopsim.world.junction import COMMIT_M, EXIT_HALF_WIDTH_M, FIRST, REQUEST_M, ROOM_M, SLOW_M_S, YIELDS

GRANTED = 0
"""The ticket of who may go. Who waits has one > 0, in the order of asking; -1: does not ask."""


@njit(cache=True, nogil=True)
def grant(
    network: LaneArrays,
    rows: NDArray[Any],
    routes: Ints,
    movement_of: Ints,
    rule: tuple[Floats, Ints],
) -> None:
    """Renew `movement` and `ticket` of everybody.

    Args:
        network: the roads.
        rows: the fleet.
        routes: the fleet's.
        movement_of: (R,) number of the movement that a road is, -1 for none.
        rule: the clearances (K, K) m and roles (K,) of the movements, see `coopsim.world.junction`.
    """
    clear_m, role = rule
    tail_m = np.empty(len(rows))
    for i in range(len(rows)):
        plan_ahead(network, rows[i], routes[i])
        tail_m[i] = _ask(network, rows[i], routes[i], movement_of, role)
    _number_new_askers(rows)
    waiting = _in_order(rows)
    before = [i for i in range(len(rows)) if rows[i].ticket == GRANTED]
    for i in waiting:
        first = role[rows[i].movement] == FIRST
        barred = _is_barred(rows, before, tail_m, clear_m[rows[i].movement], first)
        before.append(i)
        if role[rows[i].movement] == YIELDS:
            barred |= _is_passed(network, rows, routes, movement_of, role, clear_m[rows[i].movement])
        if not barred and (first or _room(network, rows, routes, movement_of, i)):
            rows[i].ticket = GRANTED


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
def _ask(network: LaneArrays, vehicle: Vehicle, route: Ints, movement_of: Ints, role: Ints) -> float:
    """Note what a vehicle asks for, and what needs no asking; returns how far along its movement its tail is, m."""
    if vehicle.driver == PARKED:
        return np.inf
    k, distance_m = line_ahead(network, vehicle, route, movement_of)
    if k < 0 or distance_m >= REQUEST_M:
        vehicle.movement, vehicle.ticket = -1, -1
        return np.inf
    movement = movement_of[route[k, 0]]
    if movement != vehicle.movement:
        vehicle.movement, vehicle.ticket = movement, -1
    # Whoever is on the junction already is a fact, however it got there; who is told what to do obeys nobody.
    if role[movement] == YIELDS and distance_m > COMMIT_M and vehicle.ticket == GRANTED:
        vehicle.ticket = -1
    if distance_m <= 0 or vehicle.driver == CHAUFFEURED:
        vehicle.ticket = GRANTED
    return -distance_m - vehicle.length / 2


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
def _is_barred(rows: NDArray[Any], before: list[int], tail_m: Floats, clear_m: Floats, first: bool) -> bool:
    """Whether somebody who may go, or asked before one who is not `first`, is not past where the ways come close."""
    barred = False
    for other in before:
        if first and rows[other].ticket > GRANTED:
            continue
        barred |= tail_m[other] < clear_m[rows[other].movement]
    return barred


@njit(cache=True, nogil=True)
def _is_passed(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, movement_of: Ints, role: Ints, clear_m: Floats
) -> bool:
    """Whether somebody comes to a movement with priority, over whichever other one, and is not past it yet."""
    for other in range(len(rows)):
        vehicle, route = rows[other], routes[other]
        if vehicle.driver == PARKED or (vehicle.ticket > GRANTED and role[vehicle.movement] != FIRST):
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
def _room(network: LaneArrays, rows: NDArray[Any], routes: Ints, movement_of: Ints, me: int) -> bool:
    """Whether the exit that a vehicle wants has room for it."""
    k, _ = line_ahead(network, rows[me], routes[me], movement_of)
    if k + 1 >= rows[me].route_length:
        return True
    lane = network.lanes[lane_of_route(network, rows[me], routes[me], k + 1)]
    for other in range(len(rows)):
        if other == me or rows[other].speed > SLOW_M_S:
            continue
        along, aside = local_coordinates(lane, rows[other].x, rows[other].y)
        room_m = ROOM_M + (rows[me].length + rows[other].length) / 2
        if -2.0 < along < room_m and abs(aside) < EXIT_HALF_WIDTH_M:
            return False
    return True
