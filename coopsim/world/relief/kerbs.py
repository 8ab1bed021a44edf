"""Raised pavements: flat tops, and upright faces of stone where they end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import numbered
from coopsim.support.kernels import njit
from coopsim.types import Ints

_TOUCH_M = 2e-3  # edges that are this close lie along each other: corners are rounded to millimetres
_LEAST_M = 1e-3  # of a piece of kerb
_DEPTH_M = 0.05  # of the stones below the road


def pavement_tops(outlines: Sequence[Floats], height_m: float) -> Floats:
    """Return triangles (T, 3, 3) m over convex outlines (K, 2) m, counter-clockwise."""
    fans = []
    for outline in outlines:
        fan = np.empty((len(outline) - 2, 3, 3))
        fan[:, 0, :2], fan[:, 1, :2], fan[:, 2, :2] = outline[0], outline[1:-1], outline[2:]
        fans.append(fan)
    tops = np.concatenate(fans) if fans else np.zeros((0, 3, 3))
    tops[..., 2] = height_m
    return tops


def kerb_faces(outlines: Sequence[Floats], height_m: float, longest_m: float = np.inf) -> Floats:
    """Return upright triangles (T, 3, 3) m around pavements, from below the road up, facing outward.

    Outlines (K, 2) m are convex and counter-clockwise. They may overlap: inside of others there is no kerb. Faces are
    at most `longest_m` long.
    """
    counts = [len(outline) for outline in outlines]
    corners = np.concatenate([np.zeros((0, 2)), *outlines])
    ends = divided(_exposed(_sorted(corners, np.cumsum([0, *counts]))), longest_m)
    a, b = (np.column_stack([ends[:, k], np.full(len(ends), -_DEPTH_M)]) for k in range(2))
    rise = np.array([0.0, 0.0, height_m + _DEPTH_M])
    return np.concatenate([np.stack([a, b, b + rise], axis=1), np.stack([a, b + rise, a + rise], axis=1)])


def divided(ends: Floats, longest_m: float) -> Floats:
    """Divide straight pieces, by their ends (N, 2, 2) m, into equal ones of at most a length; return their ends."""
    along = ends[:, 1] - ends[:, 0]
    counts = np.maximum(np.ceil(exact.hypot(along[:, 0], along[:, 1]) / longest_m), 1).astype(np.int64)
    own, place = numbered(counts)
    share = (place[:, None] + [0, 1]) / counts[own, None]
    return ends[own, :1] + share[..., None] * along[own, None] if (counts > 1).any() else ends


class _Outlines(NamedTuple):
    """Outlines in the order of their least x.

    Attributes:
        corners: (C, 2), corners of all outlines, one after the other.
        start: (P,) first corner of each outline.
        end: (P,) first corner behind it.
        bounds: (P, 4) least and greatest x, least and greatest y.
        widest: largest width along x.
    """

    corners: Floats
    start: Ints
    end: Ints
    bounds: Floats
    widest: float


def _sorted(corners: Floats, start: Ints) -> _Outlines:
    """Sort outlines, given by corners (C, 2) and their first corners (P + 1,), by their least x."""
    if len(start) < 2:
        return _Outlines(corners, start[:0], start[:0], np.zeros((0, 4)), 0.0)
    low, high = (reach.reduceat(corners, start[:-1], axis=0) for reach in (np.minimum, np.maximum))
    bounds = np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]]) + [-_TOUCH_M, _TOUCH_M] * 2
    order = np.argsort(bounds[:, 0], kind="stable")
    widest = float((bounds[:, 1] - bounds[:, 0]).max())
    return _Outlines(corners, start[:-1][order], start[1:][order], bounds[order], widest)


def _exposed(outlines: _Outlines) -> Floats:
    """Return the ends (N, 2, 2) of the pieces of all outlines' edges that are inside no other outline."""
    corners = outlines.corners
    following = np.arange(1, len(corners) + 1)
    following[outlines.end - 1] = outlines.start
    low_x = np.minimum(corners[:, 0], corners[following, 0])
    candidates = np.searchsorted(outlines.bounds[:, 0], low_x - outlines.widest)
    edge, share = np.empty(4 * len(corners) + 64, np.int64), np.empty((4 * len(corners) + 64, 2))
    while (count := _pieces(outlines, following, candidates, edge, share)) > len(edge):
        edge, share = np.empty(count, np.int64), np.empty((count, 2))
    edge, share = edge[:count], share[:count, :, None]
    a, b = corners[edge][:, None], corners[following[edge]][:, None]
    return a + share * (b - a)


@njit(cache=True, nogil=True)
def _pieces(outlines: _Outlines, following: Ints, candidates: Ints, edge: Ints, share: Floats) -> int:
    """Find the pieces of all outlines' edges that are inside no other outline; return their number.

    Args:
        outlines: P outlines with C corners.
        following: (C,) corner after each.
        candidates: (C,) first outline that may hide the edge that begins at each corner.
        edge: (N,) filled with the first corners of the edges, as far as it reaches.
        share: (N, 2), filled with the shares of the edges at which pieces begin and end.
    """
    corners, count = outlines.corners, 0
    hidden = np.empty((len(outlines.start), 2))
    for p in range(len(outlines.start)):
        for c in range(outlines.start[p], outlines.end[p]):
            a, b = corners[c], corners[following[c]]
            found = _hide(a, b, p, candidates[c], outlines, hidden)
            least = _LEAST_M / max(exact.hypot(b[0] - a[0], b[1] - a[1]), 1e-9)
            at = 0.0
            for k in range(found + 1):
                until = hidden[k, 0] if k < found else 1.0
                if until - at > least:
                    if count < len(edge):
                        edge[count], share[count, 0], share[count, 1] = c, at, until
                    count += 1
                if k < found:
                    at = max(at, hidden[k, 1])
    return count


@njit(cache=True, nogil=True)
def _hide(a: Floats, b: Floats, own: int, candidate: int, outlines: _Outlines, hidden: Floats) -> int:
    """Fill `hidden` (P, 2) with first and last share of an edge of one outline within others; return their number.

    First shares ascend. Outlines before `candidate` end before the edge begins.
    """
    found, bounds = 0, outlines.bounds
    low_x, high_x, low_y, high_y = min(a[0], b[0]), max(a[0], b[0]), min(a[1], b[1]), max(a[1], b[1])
    for p in range(candidate, len(bounds)):
        if bounds[p, 0] > high_x:
            break
        if p == own or bounds[p, 1] < low_x or bounds[p, 2] > high_y or bounds[p, 3] < low_y:
            continue
        first, last = _inside(a, b, outlines.corners[outlines.start[p] : outlines.end[p]], p < own)
        if first < last:
            place = found
            while place > 0 and hidden[place - 1, 0] > first:
                hidden[place, 0], hidden[place, 1] = hidden[place - 1, 0], hidden[place - 1, 1]
                place -= 1
            hidden[place, 0], hidden[place, 1] = first, last
            found += 1
    return found


@njit(cache=True, nogil=True)
def _inside(a: Floats, b: Floats, outline: Floats, twice: bool) -> tuple[float, float]:
    """Return the shares of an edge from a to b between which it is inside a convex outline (Cyrus and Beck 1978).

    An edge along one of the outline's is inside if the two outlines are on different sides of it or, when `twice` says
    that this edge is there already, on the same side.
    """
    first, last = 0.0, 1.0
    for k in range(len(outline)):
        here, there = outline[k], outline[(k + 1) % len(outline)]
        ex, ey = there[0] - here[0], there[1] - here[1]
        length = exact.hypot(ex, ey)
        at_a, at_b = ex * (a[1] - here[1]) - ey * (a[0] - here[0]), ex * (b[1] - here[1]) - ey * (b[0] - here[0])
        if max(abs(at_a), abs(at_b)) < _TOUCH_M * length:
            if ex * (b[0] - a[0]) + ey * (b[1] - a[1]) > 0 and not twice:
                return 1.0, 0.0
            continue
        if at_a < 0 and at_b < 0:
            return 1.0, 0.0
        if at_a < 0:
            first = max(first, at_a / (at_a - at_b))
        elif at_b < 0:
            last = min(last, at_a / (at_a - at_b))
    return first, last
