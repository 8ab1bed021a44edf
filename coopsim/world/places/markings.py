"""Painted lines: dashes wherever two straight lanes lie side by side."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.places.road_network import Road, RoadNetwork, StraightLane

_DASH_M, _PERIOD_M, _HALF_M = 3.0, 7.5, 0.1
_TOUCH_M = 0.3  # largest gap between the edges of two lanes side by side


def lane_lines(network: RoadNetwork, movements: Collection[Road] = ()) -> tuple[Floats, ...]:
    """Return dashes (4, 2) m, counter-clockwise.

    Args:
        network: the roads.
        movements: roads over a junction, where no lines are painted.
    """
    lanes = [
        lane for index, lane in network.lanes.items() if isinstance(lane, StraightLane) and index[:2] not in movements
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
    shared = (ahead_m > 0) & (ahead_m < length_m) & (np.abs(np.abs(aside_m) - half_m) < _TOUCH_M)
    # A line between opposite lanes is the left edge of both: it belongs to the first.
    shared &= (aside_m < 0) | (np.arange(len(lanes)) > own[:, None])
    painted = shared.any(axis=1)
    reach, aside = _DASH_M / 2 * along[own], _HALF_M * left[own]
    corners = (-reach - aside, reach - aside, reach + aside, aside - reach)
    return tuple(np.stack([middle + corner for corner in corners], axis=1)[painted])
