"""Narrow bends of long lanes, as roads of their own: vehicles that need the oncoming lane wait before them."""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np

from coopsim.data.maps.place.lines import part_of, spaced
from coopsim.data.maps.place.strips import Strip, Strips
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats
from coopsim.world.places.polyline import BEND_M, LONGEST_M

_STEP_M, _STEPS = 1.0, 6  # the radius of a bend counts over so many steps
_BESIDE_M = 5.0  # before and behind a bend long vehicles reach as far
_LEAST_M = 15.0  # shorter lanes before or behind it become parts of it


def part_bends(strips: Strips, lanes: Container[str]) -> None:
    """Divide long single ones of some lanes before and behind their narrow bends; the last part keeps the name."""
    for lane in list(strips.all.values()):
        if lane.name in lanes and lane.left is None and lane.right is None and lane.length_m >= LONGEST_M:
            _part(strips, lane, sorted({end_m for bend in _bends(lane) for end_m in bend}))


def _bends(lane: Strip) -> list[Floats]:
    """Return where narrow bends of a lane start, are divided because they are too long to be one, and end, m."""
    line, length_m = spaced(lane.line, _STEP_M)[:, :2], lane.length_m
    step = np.diff(line, axis=0)
    heading = np.unwrap(exact.arctan2(step[:, 1], step[:, 0]))
    narrow = np.flatnonzero(np.abs(heading[_STEPS:] - heading[:-_STEPS]) > _STEPS * _STEP_M / BEND_M)
    if not len(narrow):
        return []
    along_m, found = along_of(line), list[Floats]()
    for each in np.split(narrow, 1 + np.flatnonzero(np.diff(narrow) > (_LEAST_M + 2 * _BESIDE_M) / _STEP_M)):
        start_m, end_m = along_m[each[0]] - _BESIDE_M, along_m[each[-1] + _STEPS] + _BESIDE_M
        start_m = start_m if start_m > _LEAST_M else 0.0
        end_m = end_m if end_m < length_m - _LEAST_M else length_m
        found.append(np.linspace(start_m, end_m, 2 + int((end_m - start_m) / LONGEST_M)))
    return found


def _part(strips: Strips, lane: Strip, ends_m: Sequence[float]) -> None:
    """Divide a lane at distances along it."""
    whole, width_m = lane.line, lane.width_m
    spans = list(pairwise(sorted({0.0, *ends_m, lane.length_m})))
    for start_m, end_m in spans[:-1]:
        name = _free_name(strips, lane.name)
        part = part_of(whole, width_m, start_m, end_m)
        strips.all[name] = Strip(name, lane.start, f"{name}|", *part, lane.speed_m_s)
        lane.start = f"{name}|"
    lane.line, lane.width_m = part_of(whole, width_m, *spans[-1])


def _free_name(strips: Strips, name: str) -> str:
    """Return a name with as many "~" at its end that no strip has it; `describe_place` knows lanes without them."""
    while name in strips.all:
        name += "~"
    return name
