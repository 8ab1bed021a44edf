"""Lines of lanes: parts of them, corners made round, points that are not needed left out."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of, keep_corners
from coopsim.geometry.se3 import Floats, wrap_angle

ACCURACY_M = 0.05
"""Farthest that points which are left out may lie from the line."""

_ROUNDING_M = 1e-6
_NEAR_M = 0.15  # points nearer to the one before are left out
_SHARP_RAD, _SHORT_M = np.radians(40.0), 2.0  # corners that are left out
_CORNER_RAD = np.radians(25.0)  # corners that are sharper are made round
_SLIGHT_RAD, _LONG_M = np.radians(8.0), 2.0  # and so are slighter ones, where there is so much room
_CORNER_M = 4.0  # from a corner, at most, where the round begins
_PULL = 0.4  # of the way between the ends, which a curve follows their directions
_CURVE_M = 1.5


def part_of(line: Floats, values: Floats, start_m: float, end_m: float) -> tuple[Floats, Floats]:
    """Return a part of a line (K, 3), and of values (K,) along it."""
    along = along_of(line)
    inner = along[(along > start_m + _ROUNDING_M) & (along < end_m - _ROUNDING_M)]
    at = np.concatenate([[start_m], inner, [end_m]])
    part = np.column_stack([np.interp(at, along, column) for column in line.T])
    return part, np.asarray(np.interp(at, along, values))


def heading_of(line: Floats) -> float:
    """Return the direction from the first to the last point of a line, rad."""
    x, y = (line[-1] - line[0])[:2]
    return float(exact.arctan2(y, x))


def turn_rad(before: Floats, after: Floats) -> float:
    """Return the angle between the directions of two lines."""
    return abs(float(wrap_angle(heading_of(after) - heading_of(before))))


def rounded(line: Floats, width_m: Floats) -> tuple[Floats, Floats]:
    """Return a line without points that coincide, whose sharp corners are cut, twice where needed."""
    apart = np.concatenate([[np.inf], exact.norm(np.diff(line[:, :2], axis=0))])
    kept = apart > _NEAR_M
    kept[-1] = True
    if len(line) > 2 and apart[-1] <= _NEAR_M and kept[:-1].sum() > 1:
        kept[np.flatnonzero(kept[:-1])[-1]] = False
    line, width_m = _blunt(line[kept], width_m[kept])
    for _ in range(2):
        along = along_of(line)
        turns, steps = turns_rad(line), np.diff(along)
        reach_m = np.minimum(np.minimum(steps[:-1], steps[1:]) / 3, _CORNER_M)
        cut = (reach_m > np.where(turns > _CORNER_RAD, _NEAR_M, _LONG_M)) & (turns > _SLIGHT_RAD)
        sharp, reach_m = 1 + np.flatnonzero(cut), reach_m[cut]
        at = np.sort(np.concatenate([np.delete(along, sharp), along[sharp] - reach_m, along[sharp] + reach_m]))
        line = np.column_stack([np.interp(at, along, column) for column in line.T])
        width_m = np.asarray(np.interp(at, along, width_m))
    return line, width_m


def turns_rad(line: Floats) -> Floats:
    """Return by how much a line (K, 3) turns at its inner points (K - 2,), rad."""
    step = np.diff(line[:, :2], axis=0)
    heading = exact.arctan2(step[:, 1], step[:, 0])
    return np.asarray(np.abs(wrap_angle(np.diff(heading))))


def _blunt(line: Floats, width_m: Floats) -> tuple[Floats, Floats]:
    """Leave out the points of corners that are too sharp and too near to another point to be cut."""
    while len(line) > 2:
        steps = exact.norm(np.diff(line[:, :2], axis=0))
        worst = np.where(np.minimum(steps[1:], steps[:-1]) < _SHORT_M, turns_rad(line), 0.0)
        if worst.max() < _SHARP_RAD:
            break
        left = np.arange(len(line)) != 1 + int(np.argmax(worst))
        line, width_m = line[left], width_m[left]
    return line, width_m


def curve_between(start: Floats, ahead: Floats, end: Floats, beyond: Floats) -> Floats:
    """Return a curve (K, 3) from a point (3,) in a direction (3,) to another point, where it has another direction."""
    length_m = float(exact.norm((end - start)[:2]))
    first, last = (_PULL * length_m * each / max(float(exact.norm(each[:2])), _ROUNDING_M) for each in (ahead, beyond))
    points = np.array([start, start + first, end - last, end])
    share = np.linspace(0.0, 1.0, max(6, int(length_m / _CURVE_M) + 1))[:, None]
    rest = 1.0 - share
    weights = np.hstack([rest**3, 3 * share * rest**2, 3 * share**2 * rest, share**3])
    return np.asarray(sum(weights[:, k : k + 1] * points[k] for k in range(4)))


def spaced(line: Floats, step_m: float) -> Floats:
    """Return points (N, 3) along a line, at most `step_m` apart."""
    along = along_of(line)
    at = np.linspace(0.0, along[-1], int(along[-1] / step_m) + 2)
    return np.column_stack([np.interp(at, along, column) for column in line.T])


def simplified(line: Floats, width_m: Floats) -> tuple[Floats, Floats]:
    """Leave out points that lie nearly on the line, where the width, too, hardly differs."""
    kept = keep_corners(np.column_stack([line[:, :2], width_m]), ACCURACY_M)
    return line[kept], width_m[kept]
