"""Raised pavements of a file, which may not lie across lanes: wheels and bumpers would stick in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.custom.clearance import Kerbs
from coopsim.world.custom.paving import PAVEMENT

_LEAST_M = 0.5  # from the middle of a lane: pavements reach under the edges of lanes, in kinks by up to a metre


def require_off_lanes(outlines: Sequence[Floats], paved: Entry, kerbs: Kerbs) -> None:
    """Refuse raised pavements in the way of vehicles.

    Args:
        outlines: convex, (K, 2) m, counter-clockwise.
        paved: the list in the file with these outlines in their order, among others of other kinds.
        kerbs: of the roads.

    Raises:
        CoopsimError: of the entry's class; it says where the mistake is.
    """
    ends = np.cumsum([len(outline) for outline in outlines])
    number, segment = _first_across(np.concatenate(outlines), ends, kerbs.starts, kerbs.ends, _LEAST_M)
    if number >= 0:
        entries = [entry for entry in paved.entries() if entry.fields(("outline", "kind"))["kind"].text() == PAVEMENT]
        raise entries[number].error(
            f"a raised pavement must be at least {_LEAST_M:g} m from the middle of every lane, and this one is "
            f"nearer to that of the road in {kerbs.spot(segment)}: move it, or give a crosswalk instead"
        )


@njit(cache=True, nogil=True)
def _first_across(corners: Floats, ends: Ints, start: Floats, end: Floats, least_m: float) -> tuple[int, int]:
    """Return the first outline that is too near to a segment, and this segment; -1, -1: none is.

    Args:
        corners: (C, 2) m of all outlines, one after the other, each convex and counter-clockwise.
        ends: (P,) number of the first corner behind each outline.
        start: (S, 2) m of segments.
        end: (S, 2) m of the same.
        least_m: accepted distance.
    """
    first = 0
    for number in range(len(ends)):
        outline = corners[first : ends[number]]
        first = ends[number]
        low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
        for x, y in outline:
            low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
        for k in range(len(start)):
            ax, ay, bx, by = start[k, 0], start[k, 1], end[k, 0], end[k, 1]
            if max(ax, bx) + least_m < low_x or min(ax, bx) - least_m > high_x:
                continue
            if max(ay, by) + least_m < low_y or min(ay, by) - least_m > high_y:
                continue
            if _is_near(outline, ax, ay, bx, by, least_m):
                return number, k
    return -1, -1


@njit(cache=True, nogil=True)
def _is_near(outline: Floats, ax: float, ay: float, bx: float, by: float, reach_m: float) -> bool:
    """Return whether a segment from a to b comes nearer than `reach_m` to a convex outline (K, 2) m, or into it."""
    enter, leave = 0.0, 1.0  # shares of the segment that are inside all sides so far
    for k in range(len(outline)):
        px, py = outline[k]
        qx, qy = outline[(k + 1) % len(outline)]
        if (
            min(
                _distance_m(px, py, ax, ay, bx, by),
                _distance_m(ax, ay, px, py, qx, qy),
                _distance_m(bx, by, px, py, qx, qy),
            )
            < reach_m
        ):
            return True
        at_a = (qx - px) * (ay - py) - (qy - py) * (ax - px)  # > 0: on the inner side of this side
        at_b = (qx - px) * (by - py) - (qy - py) * (bx - px)
        if at_a < 0 and at_b < 0:
            leave = -1.0
        elif at_a < 0:
            enter = max(enter, at_a / (at_a - at_b))
        elif at_b < 0:
            leave = min(leave, at_a / (at_a - at_b))
    return enter < leave


@njit(cache=True, nogil=True)
def _distance_m(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of a point from the segment from a to b."""
    along_x, along_y = bx - ax, by - ay
    length_m2 = max(along_x * along_x + along_y * along_y, 1e-12)
    share = min(max(((x - ax) * along_x + (y - ay) * along_y) / length_m2, 0.0), 1.0)
    distance_m: float = exact.hypot(x - ax - share * along_x, y - ay - share * along_y)
    return distance_m
