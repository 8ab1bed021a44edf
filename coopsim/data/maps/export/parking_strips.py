"""Parking strips along the streets of a drawn town."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.kerbs import STREET, trace_rounds
from coopsim.world.towns.plan import Plan

_BENT_M = 0.02

Strips = Mapping[tuple[int, bool], tuple[Floats, Floats]]
"""Widths of parking strips by street and direction of the lanes beside them: places along the street, and widths."""


def parking_strips(plan: Plan) -> Strips:
    """Return the strips of all streets."""
    found = dict[tuple[int, bool], tuple[Floats, Floats]]()
    for side, _ in (part for each in trace_rounds(plan) for part in each.parts(STREET)):
        order = np.argsort(side.along_m)
        line = np.column_stack([side.along_m, side.strip_m])[order]
        kept = line[keep_corners(line, _BENT_M)]
        found[side.number, side.arm > 0] = kept[:, 0], kept[:, 1]
    return found
