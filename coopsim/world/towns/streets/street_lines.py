"""Centre lines of streets: lines through points whose corners are rounded."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import LANE_M, Stretch

_SHARPEST_M = 20.0  # least radius of a centre line: the lane inside still has room for a bus
_SHORTEST_M = 6.0  # length of an arc, and of a straight piece that is not of length 0
_WIDEST_M = 140.0  # largest radius


def rounded(points: Floats, straight_m: tuple[float, float], lanes: int) -> tuple[Stretch, ...] | None:
    """Return a line from the first to the last point, with an arc as wide as possible at every other one.

    Args:
        points: (K, 2) m.
        straight_m: lengths at both ends where the line must be straight.
        lanes: number of lanes on either side, for which the bends must be wide enough.

    Returns:
        None if there is no room for the arcs.
    """
    legs = np.diff(points, axis=0)
    lengths = exact.hypot(legs[:, 0], legs[:, 1]).tolist()
    headings = exact.arctan2(legs[:, 1], legs[:, 0]).tolist()
    free = list(lengths)  # of each leg, without what must be straight
    free[0] -= straight_m[0]
    free[-1] -= straight_m[1]
    stretches, at, spare = list[Stretch](), points[0], 0.0
    for k, heading in enumerate(headings):
        last = k == len(headings) - 1
        share_m = free[k] if k == 0 else free[k] / 2
        if last:
            if lengths[k] - spare < _SHORTEST_M or free[k] - (spare if k else 0.0) < 0.0:
                return None
            stretches.append(Stretch(at, heading, lengths[k] - spare))
            break
        turn = math.remainder(headings[k + 1] - heading, 2 * math.pi)
        ahead_m = free[k + 1] if k + 1 == len(headings) - 1 else free[k + 1] / 2
        room_m = min(share_m, ahead_m) - _SHORTEST_M
        radius = min(room_m / exact.tan(abs(turn) / 2), _WIDEST_M) if turn else 0.0
        inside_m = LANE_M * lanes
        if radius < _SHARPEST_M + inside_m - LANE_M or (radius - inside_m) * abs(turn) < _SHORTEST_M:
            return None
        tangent_m = radius * exact.tan(abs(turn) / 2)
        straight = lengths[k] - spare - tangent_m
        stretches.append(Stretch(at, heading, straight))
        at = at + straight * np.array([exact.cos(heading), exact.sin(heading)])
        stretches.append(Stretch(at, heading, radius * abs(turn), math.copysign(1 / radius, turn)))
        at = points[k + 1] + tangent_m * np.array([exact.cos(headings[k + 1]), exact.sin(headings[k + 1])])
        spare = tangent_m
    return tuple(stretches)
