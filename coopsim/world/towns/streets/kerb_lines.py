"""The kerbs around a junction: where its own surface ends between two arms."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import LANE_M, Junction

_CHORD_M = 2.0  # of an arc
_STRAIGHT_M = 400.0  # kerbs of a larger radius are straight


def corner_kerb(junction: Junction, arm: int) -> Floats:
    """Return the kerb from an arm to the next one, counter-clockwise.

    It begins at the outer edge of the arm's stop line (the outermost lane inwards), and ends where the next arm's
    outermost lane outwards begins, at its outer edge. Inside of it, towards the centre, vehicles drive.

    Returns:
        Points (K, 2) m, K >= 2, at most `2` m apart in bends.
    """
    after = (arm + 1) % len(junction.arms)
    ends = (
        junction.place(arm, junction.stop_m, junction.half_m),
        junction.place(after, junction.stop_m, -junction.half_m),
    )
    if junction.kind == "roundabout":
        return _ring_kerb(junction, arm, after)
    reach_m = junction.stop_m * exact.tan(
        junction.gap_rad(arm) / 2
    )  # to the middle of the bend; < 0: on the other side
    if abs(reach_m) > _STRAIGHT_M:
        return np.array(ends)
    return arc_points(junction.place(arm, junction.stop_m, reach_m), *ends)


def arc_points(centre: Floats, start: Floats, end: Floats) -> Floats:
    """Return points (K, 2) m from `start` (2,) to `end` (2,) on the shorter arc around `centre` (2,)."""
    first, last = (exact.arctan2(*(point - centre)[::-1]) for point in (start, end))
    swept = (last - first + np.pi) % (2 * np.pi) - np.pi
    radius = float(exact.norm(start - centre))
    angle = first + np.linspace(0.0, swept, max(2, int(np.ceil(radius * abs(swept) / _CHORD_M)) + 1))
    points: Floats = centre + radius * np.column_stack([exact.cos(angle), exact.sin(angle)])
    points[0], points[-1] = start, end
    return points


def touch_rad(junction: Junction) -> float:
    """Return the angle at a roundabout's centre between an arm and the place where its bends touch the ring."""
    return float(exact.arcsin((junction.entry_m + junction.inner_m) / (junction.ring_m + junction.entry_m)))


def _ring_kerb(junction: Junction, arm: int, after: int) -> Floats:
    outer_m, aside_m = junction.ring_m + LANE_M / 2, junction.entry_m + junction.inner_m
    parts = []
    touch = [
        junction.arms[arm].heading_rad + touch_rad(junction),
        junction.arms[after].heading_rad - touch_rad(junction),
    ]
    spots = [junction.centre + outer_m * np.array([exact.cos(angle), exact.sin(angle)]) for angle in touch]
    stop_m, half_m = junction.stop_m, junction.half_m
    parts.append(arc_points(junction.place(arm, stop_m, aside_m), junction.place(arm, stop_m, half_m), spots[0]))
    parts.append(arc_points(junction.centre, *spots)[1:])
    end = junction.place(after, stop_m, -half_m)
    parts.append(arc_points(junction.place(after, stop_m, -aside_m), spots[1], end)[1:])
    return np.concatenate(parts)
