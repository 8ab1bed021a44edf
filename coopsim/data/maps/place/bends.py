"""Narrow bends of long lanes, as roads of their own: vehicles that need the oncoming lane wait before them."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from coopsim.data.maps.place.lines import part_of, spaced
from coopsim.data.maps.place.strips import Strip, Strips
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.world.places.polyline import BEND_M, LONGEST_M

_STEP_M, _STEPS = 1.0, 6  # the radius of a bend counts over so many steps
_BESIDE_M = 5.0  # before and behind a bend long vehicles reach as far
_LEAST_M = 15.0  # shorter lanes before or behind it become parts of it


def part_bends(strips: Strips, lanes: Container[str]) -> None:
    """Divide long single ones of some lanes before and behind their narrow bends; the last part keeps the name."""
    for lane in list(strips.all.values()):
        if lane.name in lanes and lane.left is None and lane.right is None and lane.length_m >= LONGEST_M:
            gone_m = 0.0
            for start_m, end_m in _bends(lane):
                gone_m += _part(strips, lane, start_m - gone_m, end_m - gone_m)


def _bends(lane: Strip) -> list[tuple[float, float]]:
    """Return where narrow bends of a lane start and end along it, m."""
    line = spaced(lane.line, _STEP_M)[:, :2]
    step = np.diff(line, axis=0)
    heading = np.unwrap(exact.arctan2(step[:, 1], step[:, 0]))
    narrow = np.flatnonzero(np.abs(heading[_STEPS:] - heading[:-_STEPS]) > _STEPS * _STEP_M / BEND_M)
    if not len(narrow):
        return []
    along_m = along_of(line)
    parts = np.split(narrow, 1 + np.flatnonzero(np.diff(narrow) > _LEAST_M / _STEP_M))
    return [(float(along_m[each[0]]) - _BESIDE_M, float(along_m[each[-1] + _STEPS]) + _BESIDE_M) for each in parts]


def _part(strips: Strips, lane: Strip, start_m: float, end_m: float) -> float:
    """Take a bend, and what is before it, from a lane; return the length taken, m.

    None where vehicles would wait too far from the bend, or nothing would be left of the lane.
    """
    length_m = lane.length_m
    start_m = start_m if start_m > _LEAST_M else 0.0
    if end_m - start_m >= LONGEST_M or end_m > length_m - _LEAST_M:
        return 0.0
    for first_m, last_m in ((0.0, start_m), (start_m, end_m)):
        if last_m > first_m:
            line, width_m = part_of(lane.line, lane.width_m, first_m, last_m)
            name = _free_name(strips, lane.name)
            strips.all[name] = Strip(name, lane.start, f"{name}|", line, width_m, lane.speed_m_s)
            lane.start = f"{name}|"
    lane.line, lane.width_m = part_of(lane.line, lane.width_m, end_m, length_m)
    return end_m


def _free_name(strips: Strips, name: str) -> str:
    """Return a name with as many "~" at its end that no strip has it; `describe_place` knows lanes without them."""
    while name in strips.all:
        name += "~"
    return name
