"""The way ahead of a car in SUMO, as its planner gets it."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types.driving import GIVES_WAY, HAS_PRIORITY, NOBODY_FIRST, Route
from coopsim.world.places.polyline import LATERAL_M_S2
from coopsim.world.traffic.way_ahead import REACH_M, SPACING_M

_RIGHTS = dict.fromkeys("MG", HAS_PRIORITY) | dict.fromkeys("mgosw", GIVES_WAY)
"""Right of way by SUMO's letter of a link; of others, whoever comes first goes first."""

_CLOSED = "ryuY"
_STOPPING_M_S2, _BEFORE_LINE_M = 4.0, 1.0  # braking for a yellow light; left before the line by the bumper
_BEND = 4  # points, over which a bend is measured


def way_ahead(sumo: Any, name: str, middle: Floats, heading: float) -> Route:
    """Return the way along a vehicle's lanes in its own frame; where they end, it goes straight on.

    Args:
        sumo: libsumo.
        name: the vehicle.
        middle: (2,) m, of its footprint, in the network's plane.
        heading: its heading, rad.
    """
    lanes, closed = _lanes(sumo, name)
    shapes = [np.array(sumo.lane.getShape(lane)) for lane, _ in lanes]
    end_m = np.cumsum([along_of(shape)[-1] for shape in shapes])
    line = np.concatenate(shapes)
    line = line[np.concatenate([[True], exact.norm(np.diff(line, axis=0)) > 1e-3])]
    step = line[-1] - line[-2]
    line = np.vstack([line, line[-1] + 2 * REACH_M * step / exact.norm(step)])
    drawn_m = end_m[0] / sumo.lane.getLength(lanes[0][0])  # a lane's length need not be that of its line
    half_m = sumo.vehicle.getLength(name) / 2
    start_m = sumo.vehicle.getLanePosition(name) * drawn_m - half_m
    if start_m < 0:  # its middle is in the lane before
        line, end_m, start_m = np.vstack([middle, line]), end_m - start_m, 0.0
    place_m = start_m + SPACING_M * np.arange(round(REACH_M / SPACING_M) + 1)
    along_m = along_of(line)
    points = np.column_stack([np.interp(place_m, along_m, line[:, k]) for k in (0, 1)])
    at = np.minimum(np.searchsorted(end_m, place_m), len(lanes) - 1)
    limit_m_s = np.minimum(np.array([sumo.lane.getMaxSpeed(lane) for lane, _ in lanes])[at], _comfortable(points))
    rights = np.array([right for _, right in lanes])[at]
    way_m = end_m[closed] - start_m - half_m if closed is not None else np.inf
    if way_m > sumo.vehicle.getSpeed(name) ** 2 / (2 * _STOPPING_M_S2):
        beyond = place_m - start_m >= max(way_m - _BEFORE_LINE_M, 0.0)
        limit_m_s[beyond], rights[beyond] = 0.0, GIVES_WAY
    cos, sin = exact.cos(heading), exact.sin(heading)
    return Route((points - middle) @ np.array([[cos, -sin], [sin, cos]]), SPACING_M, limit_m_s, rights)


def _lanes(sumo: Any, name: str) -> tuple[list[tuple[str, int]], int | None]:
    """Return a vehicle's lane and those ahead with their right of way, and after which of them a light is closed."""
    lanes, closed = [(sumo.vehicle.getLaneID(name), NOBODY_FIRST)], None
    far_m = sumo.vehicle.getLanePosition(name) + REACH_M
    for lane, _, _, _, via, state, _, _ in sumo.vehicle.getNextLinks(name):
        if sum(sumo.lane.getLength(each) for each, _ in lanes) > far_m:
            break
        if state in _CLOSED and closed is None:
            closed = len(lanes) - 1
        while via:
            lanes.append((via, _RIGHTS.get(state, NOBODY_FIRST)))
            via = next((each[4] for each in sumo.lane.getLinks(via)), "")
        lanes.append((lane, NOBODY_FIRST))
    return lanes, closed


def _comfortable(points: Floats) -> Floats:
    """Return the speed (K,) m/s at which each point of a way is passed in comfort, by how it bends there."""
    step = np.diff(points, axis=0)
    heading = exact.arctan2(step[:, 1], step[:, 0])
    bend = np.abs(wrap_angle(heading[_BEND:] - heading[:-_BEND])) / (_BEND * SPACING_M)
    curvature = np.pad(bend, (_BEND // 2, len(points) - len(bend) - _BEND // 2), mode="edge")
    speed: Floats = np.sqrt(LATERAL_M_S2 / np.maximum(curvature, 1e-6))
    return speed
