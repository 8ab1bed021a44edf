"""Crossings for people: those of a map, or, in a map without any, one over every arm of its junctions."""

from __future__ import annotations

import numpy as np

from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.roads import Roads
from coopsim.data.maps.street_map import DRIVEN, StreetCrossing, StreetLane, StreetMap
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats

_BEFORE_M, _WIDTH_M = 3.0, 3.0  # from a junction to the middle of a crossing, and its width
_LONGEST_M, _STEP_M = 30.0, 0.5
_APART_M = 14.0  # two crossings of one junction
_FEWEST_WAYS = 4
_SHORTEST_M = 15.0  # of a lane with a crossing


def crossings_of(streets: StreetMap, roads: Roads) -> tuple[StreetCrossing, ...]:
    """Return a map's crossings; if it has none, made ones where lanes lead into and out of junctions."""
    if streets.crossings:
        return streets.crossings
    ways: dict[str, list[str]] = {}
    for way in streets.ways.values():
        ways.setdefault(way.junction, []).append(way.id)
    found = list[StreetCrossing]()
    for names in (each for each in ways.values() if len(each) >= _FEWEST_WAYS):
        own = list[Floats]()
        ends = dict.fromkeys((streets.ways[name].start, -1) for name in names)
        ends |= dict.fromkeys((streets.ways[name].end, 0) for name in names)
        for lane, end in ends:
            line = _across(streets.lanes[lane], end, roads.field)
            if line is None or any(exact.norm(line.mean(axis=0) - other) < _APART_M for other in own):
                continue
            own.append(line.mean(axis=0))
            place = np.column_stack([line, np.zeros(2)])
            found.append(StreetCrossing(f"{lane}{'<' if end else '>'}", place, _WIDTH_M, (streets.lanes[lane].road,)))
    return tuple(found)


def _across(lane: StreetLane, end: int, ground: Field) -> Floats | None:
    """Return the line (2, 2) m over a road before the end (-1) of a lane or behind its beginning (0)."""
    if lane.kind not in DRIVEN or lane.length_m < _SHORTEST_M:
        return None
    line = lane.line[::-1, :2] if end else lane.line[:, :2]
    along_m = along_of(line)
    middle, beyond = (np.array([np.interp(at_m, along_m, axis) for axis in line.T]) for at_m in (_BEFORE_M, 6.0))
    ahead = (beyond - middle) / max(float(exact.norm(beyond - middle)), 1e-9)
    steps_m = np.arange(0.0, _LONGEST_M, _STEP_M)
    found = []
    for side in (1.0, -1.0):
        points = middle + steps_m[:, None] * side * np.array([-ahead[1], ahead[0]])
        clear = np.flatnonzero(ground.at(points) > _STEP_M)
        if not len(clear):
            return None
        found.append(points[clear[0]])
    line = np.array(found)
    return line if exact.norm(line[1] - line[0]) < _LONGEST_M else None
