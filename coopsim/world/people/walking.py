"""Steps of people along their ways, compiled: forces between them, vehicles that stop them, and their motion."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.traffic.fleet import Body, Vehicle

_RELAXATION_S = 0.5
_BRAKING_M_S2 = 1.5  # before crossings and bends
_AT_CROSSING_M_S = 0.3
_CAUTION_M = 2.5  # from either end of a vehicle
_CLOSING_M_S = 0.5  # of a vehicle that comes


class Walkers(NamedTuple):
    """N people on their ways.

    Attributes:
        position: (N, 2) m.
        velocity: (N, 2) m/s.
        start: (N, 2) m, of the present way.
        end: (N, 2) m, of the present way.
        speed: (N,) m/s, that each would walk at.
        will_cross: (N,) whether the next way crosses a road.
    """

    position: Floats
    velocity: Floats
    start: Floats
    end: Floats
    speed: Floats
    will_cross: Mask


@njit(cache=True, nogil=True)
def headings(people: Walkers) -> tuple[Floats, Floats]:
    """Return the unit vectors (N, 2) to the ends of people's ways, and the distances (N,) to there, m."""
    heading, distance = np.empty_like(people.position), np.empty(len(people.position))
    for n in range(len(distance)):
        x, y = people.end[n, 0] - people.position[n, 0], people.end[n, 1] - people.position[n, 1]
        distance[n] = math.sqrt(x * x + y * y)
        far = max(distance[n], 1e-9)
        heading[n, 0], heading[n, 1] = x / far, y / far
    return heading, distance


@njit(cache=True, nogil=True)
def advance(
    people: Walkers,
    heading: Floats,
    distance: Floats,
    waits: Mask,
    push: Floats,
    bend_m_s: float,
    swerve_m: float,
    dt_s: float,
) -> Floats:
    """Return the places (N, 2) that people reach in a step, if nothing stops them.

    Each relaxes towards a speed along the way that leaves time to brake for its end (`bend_m_s` there, unless a
    crossing follows), and may be pushed no farther aside than `swerve_m`, or than before.

    Args:
        people: N of them.
        heading: (N, 2), see `headings`.
        distance: (N,), see `headings`.
        waits: mask (N,) of people who stay.
        push: (N, 2) m/s2, social forces.
        bend_m_s: speed at the end of a way.
        swerve_m: greatest distance from the way's middle.
        dt_s: time step.
    """
    reached = people.position.copy()
    for n in np.flatnonzero(~waits):
        at_end = _AT_CROSSING_M_S if people.will_cross[n] else bend_m_s
        wanted = min(people.speed[n], math.sqrt(at_end * at_end + 2 * _BRAKING_M_S2 * distance[n]))
        vx, vy = people.velocity[n]
        vx = vx + ((heading[n, 0] * wanted - vx) / _RELAXATION_S + push[n, 0]) * dt_s
        vy = vy + ((heading[n, 1] * wanted - vy) / _RELAXATION_S + push[n, 1]) * dt_s
        share = min(1.0, people.speed[n] / max(math.hypot(vx, vy), 1e-9)) * dt_s
        x, y = people.position[n, 0] + vx * share, people.position[n, 1] + vy * share
        sx, sy = people.start[n]
        along_x, along_y = people.end[n, 0] - sx, people.end[n, 1] - sy
        length = max(math.sqrt(along_x * along_x + along_y * along_y), 1e-9)
        left_x, left_y = -(along_y / length), along_x / length
        before = (people.position[n, 0] - sx) * left_x + (people.position[n, 1] - sy) * left_y
        aside, limit = (x - sx) * left_x + (y - sy) * left_y, max(swerve_m, abs(before))
        excess = aside - min(max(aside, -limit), limit)
        reached[n, 0], reached[n, 1] = x - excess * left_x, y - excess * left_y
    return reached


@njit(cache=True, nogil=True)
def is_safe(place: Floats, gap_s: Floats, rows: NDArray[Any], direction: Floats) -> Mask:
    """Return the mask (N,) of places (N, 2) m that no vehicle is at, or reaches within `gap_s` (N,).

    `rows` are (V,) `VEHICLE`, `direction` (V, 2) the unit vectors of their headings.
    """
    safe = np.ones(len(place), np.bool_)
    for n in range(len(place)):
        for v in range(len(rows)):
            x, y = place[n, 0] - rows[v].x, place[n, 1] - rows[v].y
            distance, caution_m = math.sqrt(x * x + y * y), _CAUTION_M + rows[v].length / 2
            closing = (x * direction[v, 0] + y * direction[v, 1]) * rows[v].speed / max(distance, 1e-9)
            comes = closing > _CLOSING_M_S and distance < caution_m + closing * gap_s[n]
            if comes or distance < caution_m:
                safe[n] = False
                break
    return safe


_STRENGTH_M_S2 = 3.0
_RANGE_M = 0.4
_REACH_M = 2.5  # the push is below 1 per cent of its strength from here on
_BEHIND = 0.3  # relative push from behind
_RADIUS_M = 0.3

_MARGIN_M = 0.6  # to the side of a vehicle
_STANDING_M_S = 0.1
_NEAR_M = 3.5  # farther vehicles are ignored
_NEARER_M = 0.05  # by which the next step may approach a vehicle when passing along it
_FORESIGHT_S = 1.0  # during which people keep a vehicle's way free


def push_apart(position: Floats, heading: Floats, everybody: NDArray[Any]) -> Floats:
    """Return the social forces (N, 2) m/s2 on people at (N, 2) m with headings (N, 2), among others (M,) `BODY`."""
    order = np.argsort(everybody["x"], kind="stable")
    first = np.searchsorted(everybody["x"][order], position[:, 0] - _REACH_M)
    return np.asarray(_push_apart(position, heading, everybody, order, first))


@njit(cache=True, nogil=True)
def _push_apart(position: Floats, heading: Floats, everybody: NDArray[Any], order: Ints, first: Ints) -> Floats:
    force = np.zeros_like(position)
    for i in range(len(position)):
        for k in range(first[i], len(order)):
            other: Body = everybody[order[k]]
            dx, dy = position[i, 0] - other.x, position[i, 1] - other.y
            if dx < -_REACH_M:
                break
            distance = math.hypot(dx, dy)
            if distance < 1e-9 or distance > _REACH_M:  # oneself, or out of reach
                continue
            dx, dy = dx / distance, dy / distance
            radii = _RADIUS_M + max(other.length, other.width) / 2
            in_front = -(dx * heading[i, 0] + dy * heading[i, 1])
            view = _BEHIND + (1 - _BEHIND) * (1 + in_front) / 2
            push = view * _STRENGTH_M_S2 * math.exp((radii - distance) / _RANGE_M)
            # People who meet head on go to the right: a push along the line between them would stop both.
            force[i, 0] += push * (dx + 0.5 * max(in_front, 0.0) * heading[i, 1])
            force[i, 1] += push * (dy - 0.5 * max(in_front, 0.0) * heading[i, 0])
    return force


@njit(cache=True, nogil=True)
def is_blocked(
    position: Floats, ahead: Floats, rows: NDArray[Any], passes: bool, foresight_s: float = _FORESIGHT_S
) -> NDArray[np.bool_]:
    """Return the mask (N,) of people whose next step leads into a vehicle, or into where it will be in a moment.

    Args:
        position: (N, 2) m.
        ahead: (N, 2) m, from there to where the road has to be free.
        rows: (V,) `VEHICLE`.
        passes: people may go along a standing vehicle, however close: it may stand because of them.
        foresight_s: time over which vehicles are predicted; 0: only their present positions count.
    """
    blocked = np.zeros(len(position), dtype=np.bool_)
    for i in range(len(position)):
        for k in range(len(rows)):
            vehicle: Vehicle = rows[k]
            dx, dy = position[i, 0] - vehicle.x, position[i, 1] - vehicle.y
            if math.hypot(dx, dy) > vehicle.length + abs(vehicle.speed) * foresight_s + _NEAR_M:
                continue
            now = _outside(vehicle, dx, dy, foresight_s)
            soon = _outside(vehicle, dx + ahead[i, 0], dy + ahead[i, 1], foresight_s)
            # People in its way already may go on; people too close may go away from it, but not along.
            if passes and abs(vehicle.speed) < _STANDING_M_S and soon > now - _NEARER_M:
                continue
            if soon < _MARGIN_M and now > 0 and soon <= now:
                blocked[i] = True
                break
    return blocked


@njit(cache=True, nogil=True)
def _outside(vehicle: Vehicle, dx: float, dy: float, foresight_s: float) -> float:
    """Return the distance (m) of a place, relative to a vehicle's middle, from it and its way within `foresight_s`."""
    cos, sin = math.cos(vehicle.heading), math.sin(vehicle.heading)
    along, aside = dx * cos + dy * sin, abs(dy * cos - dx * sin)
    ahead = along - vehicle.length / 2 - max(vehicle.speed, 0.0) * foresight_s
    beyond = max(ahead, -vehicle.length / 2 - along, 0.0)
    return math.hypot(beyond, max(aside - vehicle.width / 2, 0.0))
