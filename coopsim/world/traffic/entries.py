"""Lanes that lead across a movement over a junction, as a navigation map has them."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.traffic.lane_geometry import position_at
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.movements import Movements

_BACK_M = np.arange(0.0, 41.0, 4.0)  # before the ends of lanes


def entering(network: LaneArrays, movements: Movements, movement: int) -> Floats:
    """Return places on lanes from which vehicles may come across a movement that does not give way to it.

    Returns:
        (A, 5): x and y, m; the speed limit, m/s; the way from there to where they leave the movement's way, m; and the
        number of their movement.
    """
    met = np.isfinite(movements.clear_m[movement]) & ~movements.yields[:, movement]
    found = [np.zeros((0, 5))]
    for other in np.flatnonzero(met).tolist():
        start = network.roads["start"][movements.road[other]]
        for road in np.flatnonzero(network.roads["end"] == start).tolist():
            first = network.roads["first_lane"][road]
            for number in range(first, first + network.roads["lanes"][road]):
                lane = network.lanes[number]
                back_m = _BACK_M[lane["length"] > _BACK_M]
                rows = np.zeros((len(back_m), 5))
                rows[:, :2] = [position_at(lane, network.corners, lane["length"] - back) for back in back_m.tolist()]
                rows[:, 2], rows[:, 3] = lane["speed_limit"], back_m + movements.clear_m[movement, other]
                rows[:, 4] = other
                found.append(rows)
    return np.concatenate(found)
