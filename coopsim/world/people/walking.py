"""One step of people along their ways, compiled: where they go, where they may not, and how fast they get there."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Mask

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

    Each relaxes towards a speed along the way that leaves time to brake for its end, and may be pushed no farther aside
    than `swerve_m`, or than before.

    Args:
        people: N of them.
        heading: (N, 2), see `headings`.
        distance: (N,), see `headings`.
        waits: (N,) who stay where they are.
        push: (N, 2) m/s2, by others.
        bend_m_s: speed at the end of a way, unless a crossing follows.
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
    """Return the mask (N,) of places that no vehicle is at or about to reach.

    Args:
        place: (N, 2) m.
        gap_s: (N,) time in which no vehicle may reach it.
        rows: (V,) `VEHICLE`.
        direction: (V, 2) unit vectors of the vehicles' headings.
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
