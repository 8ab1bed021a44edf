"""Lines of ways: joined from parts, and which way they turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.data.maps.street_map import Turn
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle

_BENT_RAD, _AROUND_RAD = np.pi / 6, 5 * np.pi / 6
_NEAR_M = 0.05


def joined(parts: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """Return one line (K, 3) and its widths (K,) from lines that follow each other; points that coincide are one."""
    line = np.concatenate([part for part, _ in parts])
    width = np.concatenate([each for _, each in parts])
    step = exact.norm(np.diff(line, axis=0))
    kept = np.concatenate([[True], step > _NEAR_M])
    kept[-1] = True
    if len(line) > 2 and step[-1] <= _NEAR_M and kept[:-1].sum() > 1:  # the end counts more than the point before it
        kept[-2] = False
    return line[kept], width[kept]


def turn_of(line: Floats) -> Turn:
    """Return which way a line (K, 3) turns, by the directions of its first and last step."""
    first, last = line[1] - line[0], line[-1] - line[-2]
    turned = float(wrap_angle(exact.arctan2(last[1], last[0]) - exact.arctan2(first[1], first[0])))
    if abs(turned) > _AROUND_RAD:
        return "around"
    if abs(turned) < _BENT_RAD:
        return "straight"
    return "left" if turned > 0 else "right"
