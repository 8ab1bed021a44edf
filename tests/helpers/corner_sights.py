"""How far one sees into crossing streets: a measure of what stands at a town's corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.world.towns.plan import LANE_M, Junction, Plan

FARTHEST_M = 150.0
"""No sight is measured beyond this."""

_BEFORE_M = 10.0  # from the eye to its stop line: where drivers who need not stop decide
_EYE_M = 1.5  # over the road
_STEP_M = 2.5
_STRAIGHT_RAD = np.radians(150.0)  # between arms: beyond this one looks straight on


def corner_sights(plan: Plan, description: Mapping[str, Any]) -> Floats:
    """Return how far drivers see up the next arms when they come to a junction, of all pairs of neighbouring arms.

    The eye is in the outermost lane, 10 m before the stop line, 1.5 m up. It looks for cars in the outermost lane that
    comes in on the arm to its right or left: the sight is the distance from that arm's stop line up to which all of the
    lane is in view. Where the street ends, its lane is thought to go on. Buildings and walls hide it; plants, furniture
    and vehicles do not.

    Args:
        plan: streets and junctions.
        description: what `dress_streets` has drawn on it.

    Returns:
        (N,) m, up to `FARTHEST_M`.
    """
    starts, ends = hiding_edges(description)
    found = []
    for junction in plan.junctions:
        for arm in range(len(junction.arms)):
            eye = _incoming(plan, junction, arm, np.array([_BEFORE_M]))[0]
            for turn in (-1, 1):
                other = (arm + turn) % len(junction.arms)
                if junction.gap_rad(arm if turn > 0 else other) > _STRAIGHT_RAD:
                    continue
                lane = _incoming(plan, junction, other, np.arange(0.0, FARTHEST_M + _STEP_M, _STEP_M))
                hidden = are_hidden(eye, lane, starts, ends)
                found.append(FARTHEST_M if not hidden.any() else _STEP_M * float(hidden.argmax()))
    return np.array(found)


def hiding_edges(description: Mapping[str, Any], height_m: float = _EYE_M) -> tuple[Floats, Floats]:
    """Return the starts and ends (N, 2) m of the edges of all buildings and walls that are higher than `height_m`."""
    starts, ends = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for item in description.get("buildings", ()):
        if item.height_m > height_m:
            outline = np.array(item.outline)
            starts.append(outline)
            ends.append(np.roll(outline, -1, axis=0))
    for item in description.get("walls", ()):
        if item.height_m > height_m:
            starts.append(np.array(item.along[:-1]))
            ends.append(np.array(item.along[1:]))
    return np.concatenate(starts), np.concatenate(ends)


def _incoming(plan: Plan, junction: Junction, arm: int, before_m: Sequence[float] | Floats) -> Floats:
    """Return places (N, 2) m in the outermost lane that comes in on an arm, at distances (N,) before its stop line."""
    street = plan.streets[junction.arms[arm].street]
    outwards = junction.arms[arm].outwards
    out_m = junction.stop_m + np.asarray(before_m)
    along_m = out_m if outwards else street.length_m - out_m
    aside_m = junction.half_m - LANE_M / 2
    return street.position(along_m, aside_m if outwards else -aside_m)


@njit(cache=True, nogil=True)
def are_hidden(eye: Floats, places: Floats, starts: Floats, ends: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the mask (N,) of places (N, 2) m whose line to the eye (2,) meets an edge from starts to ends (M, 2)."""
    hidden = np.zeros(len(places), np.bool_)
    for n in range(len(places)):
        to_x, to_y = places[n, 0] - eye[0], places[n, 1] - eye[1]
        for m in range(len(starts)):
            from_x, from_y = starts[m, 0] - eye[0], starts[m, 1] - eye[1]
            edge_x, edge_y = ends[m, 0] - starts[m, 0], ends[m, 1] - starts[m, 1]
            area = to_x * edge_y - to_y * edge_x
            if area == 0.0:
                continue
            along = (from_x * edge_y - from_y * edge_x) / area
            aside = (from_x * to_y - from_y * to_x) / area
            if 0.0 < along < 1.0 and 0.0 <= aside <= 1.0:
                hidden[n] = True
                break
    return hidden
