"""Ground that two ways share where they cross or merge: who waits before it, and where.

Whoever came first in the log goes first, so that lights, signs and courtesy need not be known. It is the order only:
nobody waits for somebody who stands, or who comes too late to be met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coopsim.data.logs.play.paths import Paths
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.world.traffic.rules import STANDING_M_S

_BESIDE_M = 0.3
"""Bodies that would pass with less between them share ground."""

_SAME_WAY = math.cos(math.radians(20.0))
"""Where ways lead in nearly the same direction, one follows the other, and nobody has to wait."""

_LONGEST_STEP_M = 1.25  # between points of a way
_APART_S = 60.0  # road users that passed at times farther apart do not meet
_BEFORE_M, _MARGIN_S = 2.0, 1.0  # left by a front bumper before the shared ground, and between one and the next on it
_STOPPING_M_S2, _SLOWLY_M_S = (
    5.0,
    3.0,
)  # who would have to brake harder goes on; with which who stands clears the ground


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """C orders: `waits` lets `goes` go first, unless it is there clearly before.

    Attributes:
        waits: (C,) way of the one.
        goes: (C,) way of the other.
        own: (C, 2) m along the one's way where the shared ground begins and ends, for its middle.
        other: (C, 2) m along the other's way, likewise.
        later: (C,) whether the one came later in the log.
    """

    waits: Ints
    goes: Ints
    own: Floats
    other: Floats
    later: Mask

    def room_m(self, along: Floats, speed: Floats, length: Floats, there: Mask, reacts: Mask) -> Floats:
        """Return how far (R,) m road users may go now before they must stand; infinite where nobody is in the way.

        Args:
            along: (R,) m along their ways.
            speed: (R,) m/s.
            length: (R,) m, of their bodies.
            there: (R,) whether they have come, and not gone.
            reacts: (R,) whether they let others go first.
        """
        me, other = self.waits, self.goes
        room = self.own[:, 0] - length[me] / 2 - _BEFORE_M - along[me]
        stops = reacts[me] & there[me] & (room > -_BEFORE_M)
        stops &= room + _BEFORE_M >= np.square(speed[me]) / (2 * _STOPPING_M_S2)
        front, rear = along[other] + length[other] / 2, along[other] - length[other] / 2
        inside = (front > self.other[:, 0]) & (rear < self.other[:, 1])
        comes_s = (self.other[:, 0] - front) / np.maximum(speed[other], STANDING_M_S)
        clear_s = (self.own[:, 1] + length[me] / 2 - along[me]) / np.maximum(speed[me], _SLOWLY_M_S)
        moves = (front <= self.other[:, 0]) & (speed[other] > STANDING_M_S)
        meets = moves & (comes_s < clear_s + _MARGIN_S) & (self.later | ~reacts[other])
        found = np.full(len(along), np.inf)
        waiting = stops & there[other] & (inside | meets)
        np.minimum.at(found, me[waiting], room[waiting])
        return found


def crossings_of(paths: Paths, width: Floats) -> Crossings:
    """Return who waits for whom, of road users of widths (R,) m on ways."""
    step = np.append(np.diff(paths.xy, axis=0), [[0.0, 0.0]], axis=0)
    last = paths.first[1:] - 1
    step[last] = step[last - 1]
    pairs, points = _meetings(paths.xy, step / exact.norm(step)[:, None], paths.first, width)
    begins = paths.time_s[points[:, ::2]]
    near = np.abs(begins[:, 0] - begins[:, 1]) < _APART_S
    pairs, begins, at = pairs[near], begins[near], paths.along[points[near]]
    later = begins[:, 0] > begins[:, 1]
    waits, goes = np.concatenate([pairs, pairs[:, ::-1]]).T
    own, other = at[:, :2], at[:, 2:]
    both = np.concatenate([own, other]), np.concatenate([other, own])
    return Crossings(waits, goes, *both, np.append(later, ~later))


@njit(cache=True, nogil=True)
def _meetings(xy: Floats, ahead: Floats, first: Ints, width: Floats) -> tuple[Ints, Ints]:
    """Return pairs of ways (C, 2), and the first and last point on the shared ground of both (C, 4)."""
    count = len(width)
    low, high = np.empty((count, 2)), np.empty((count, 2))
    for k in range(count):
        for axis in range(2):
            own = xy[first[k] : first[k + 1], axis]
            low[k, axis], high[k, axis] = own.min(), own.max()
    found = [(0, 0, 0, 0, 0, 0) for _ in range(0)]  # an empty list with a type that the compiler knows
    for a in range(count):
        for b in range(a + 1, count):
            reach = (width[a] + width[b]) / 2 + _BESIDE_M
            if (low[a] - high[b] > reach).any() or (low[b] - high[a] > reach).any():
                continue
            a_low, a_high, b_low, b_high = _shared(xy, ahead, first[a : a + 2], first[b : b + 2], reach)
            if a_low >= 0:
                found.append((a, b, a_low, a_high, b_low, b_high))
    table = np.empty((len(found), 6), np.int64)
    for k in range(len(found)):
        for column in range(6):
            table[k, column] = found[k][column]
    return table[:, :2], table[:, 2:]


@njit(cache=True, nogil=True)
def _shared(xy: Floats, ahead: Floats, of_a: Ints, of_b: Ints, reach: float) -> tuple[int, int, int, int]:
    """Return the first and last point of two ways that are near each other and lead elsewhere; -1: there are none."""
    a_low, a_high, b_low, b_high = -1, -1, -1, -1
    i = of_a[0]
    while i < of_a[1]:
        nearest, k = np.inf, of_b[0]
        while k < of_b[1]:
            apart = math.sqrt((xy[i, 0] - xy[k, 0]) ** 2 + (xy[i, 1] - xy[k, 1]) ** 2)
            nearest = min(nearest, apart)
            if apart < reach and ahead[i, 0] * ahead[k, 0] + ahead[i, 1] * ahead[k, 1] < _SAME_WAY:
                a_low, a_high = (i if a_low < 0 else a_low), i
                b_low, b_high = (k if b_low < 0 else min(b_low, k)), max(b_high, k)
            # As both ways go on in short steps, they cannot be near before.
            k += max(int((apart - reach) / _LONGEST_STEP_M), 1)
        i += max(int((nearest - reach) / _LONGEST_STEP_M), 1)
    return a_low, a_high, b_low, b_high
