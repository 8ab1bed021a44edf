"""Whether the streets of a plan leave each other room."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import LANE_M, LOOP_RADIUS_M, LOOP_REACH_M, Plan, Street

BETWEEN_M = 14.0
"""Least width between the lanes of two streets, for pavements on both sides and something between them."""

_STEP_M = 6.0
_LARGEST_M = {1: 400.0, 2: 480.0, 3: 640.0}  # extent of the streets along either side, by most lanes
_NEAR_M = 16.0  # this far beyond the stop lines streets of one junction may be closer


def are_apart(plan: Plan) -> bool:
    """Return whether streets keep their distance from others, and the town is not too large."""
    spots, half_m, street = _samples(plan)
    extent = spots.max(axis=0) - spots.min(axis=0)
    if (extent > _LARGEST_M[max(junction.lanes for junction in plan.junctions)]).any():
        return False
    gap_m = exact.norm(spots[:, None] - spots, axis=2) - half_m[:, None] - half_m
    close = (gap_m < BETWEEN_M) & (street[:, None] != street)
    for junction in plan.junctions:
        incident = np.zeros(len(plan.streets), dtype=np.bool_)
        incident[[arm.street for arm in junction.arms]] = True
        own = incident[street]
        away_m = exact.norm(spots - junction.centre, axis=1)
        if (away_m - half_m)[~own].min(initial=np.inf) < junction.stop_m + BETWEEN_M / 2:
            return False
        near = own & (away_m < junction.stop_m + junction.half_m + _NEAR_M)
        close &= ~((near[:, None] | near) & own[:, None] & own)
    return not bool(close.any())


def loop_centre(street: Street) -> Floats:
    """Return the middle (2,) m of the turning loop at the end of a street."""
    found: Floats = street.position(street.length_m + LOOP_REACH_M)[0]
    return found


def _samples(plan: Plan) -> tuple[Floats, Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return places (N, 2) m on all streets and loops, half the widths there (N,) m, and the street (N,)."""
    spots, half_m, number = [], [], []
    for street in plan.streets:
        first, last = street.span_m
        along = np.linspace(first, last, max(2, int((last - first) / _STEP_M)))
        spots.append(street.position(along))
        half_m.append(street.half_m(along))
        if street.end.junction is None:
            spots.append(loop_centre(street)[None])
            half_m.append(np.array([LOOP_RADIUS_M + LANE_M / 2]))
        number.append(np.full(len(along) + (street.end.junction is None), street.number))
    return np.concatenate(spots), np.concatenate(half_m), np.concatenate(number)
