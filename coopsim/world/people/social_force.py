"""Forces between people, and vehicles that stop them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.traffic.engine.fleet import Body, Vehicle

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
    """Return the social forces (N, 2) on people, m/s2.

    Args:
        position: (N, 2) m.
        heading: (N, 2) unit vectors, where they want to go.
        everybody: (M,) `BODY`, the same people among them.
    """
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
        passes: whether they may go along a standing vehicle, however close: it may stand because of them.
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
