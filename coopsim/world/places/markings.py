"""Lines between lanes, for pictures: dashed wherever two straight lanes lie side by side."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork

from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import Road

_DASH_M, _PERIOD_M, _HALF_M = 3.0, 7.5, 0.1
_TOUCH_M = 0.3  # between the edges of two lanes that are side by side


def lane_lines(network: RoadNetwork, movements: Collection[Road] = ()) -> tuple[Floats, ...]:
    """Dashes (4, 2) m, counter-clockwise.

    Args:
        network: whose straight lanes are looked at.
        movements: roads over a junction, where no lines are painted.
    """
    lanes = [
        lane
        for index, lane in network.lanes_dict().items()
        if isinstance(lane, StraightLane) and index[:2] not in movements
    ]
    if not lanes:
        return ()
    start, along = (np.array([getattr(lane, name) for lane in lanes]) for name in ("start", "direction"))
    length_m, half_m = np.array([lane.length for lane in lanes]), np.array([lane.width for lane in lanes]) / 2
    left = np.column_stack([-along[:, 1], along[:, 0]])
    counts = (length_m / _PERIOD_M).astype(np.int64)
    own = np.repeat(np.arange(len(lanes)), counts)
    number = np.arange(len(own)) - np.repeat(np.cumsum(counts) - counts, counts)
    at_m = (number + 0.5) * (length_m / np.maximum(counts, 1))[own]
    middle = start[own] + at_m[:, None] * along[own] + half_m[own, None] * left[own]
    offset = middle[:, None] - start
    ahead_m = (offset * along).sum(axis=2)
    aside_m = (offset * left).sum(axis=2)
    beside = (ahead_m > 0) & (ahead_m < length_m) & (np.abs(np.abs(aside_m) - half_m) < _TOUCH_M)
    # A line between two that go opposite ways is the left edge of both: the first of them has it.
    beside &= (aside_m < 0) | (np.arange(len(lanes)) > own[:, None])
    painted = beside.any(axis=1)
    reach, aside = _DASH_M / 2 * along[own], _HALF_M * left[own]
    corners = (-reach - aside, reach - aside, reach + aside, aside - reach)
    return tuple(np.stack([middle + corner for corner in corners], axis=1)[painted])
