"""Raised pavements: flat tops, and upright faces of stone where they end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_WITHIN_M = 1e-3  # an edge this deep inside another pavement is no kerb; one along the other's edge is
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


def kerb_faces(outlines: Sequence[Floats], height_m: float) -> Floats:
    """Return upright triangles (T, 3, 3) m around pavements, from below the road up, facing outward.

    Args:
        outlines: (K, 2) m each, convex, counter-clockwise; they may overlap: inside of others there is no kerb.
        height_m: of the pavements.
    """
    counts = [len(outline) for outline in outlines]
    corners = np.concatenate([np.zeros((0, 2)), *outlines])
    ends = _exposed(corners, np.cumsum([0, *counts]))
    a, b = (np.column_stack([ends[:, k], np.full(len(ends), -_DEPTH_M)]) for k in range(2))
    rise = np.array([0.0, 0.0, height_m + _DEPTH_M])
    return np.concatenate([np.stack([a, b, b + rise], axis=1), np.stack([a, b + rise, a + rise], axis=1)])


@njit(cache=True, nogil=True)
def _exposed(corners: Floats, start: Ints) -> Floats:
    """Return the ends (N, 2, 2) of the pieces of all outlines' edges that are inside no other outline.

    Args:
        corners: (C, 2) of all outlines, one after the other.
        start: (P + 1,) first corner of each outline and, last, their number.
    """
    count, ends = 0, np.empty((4 * len(corners) + 64, 2, 2))
    outlines = len(start) - 1
    low, high = np.empty((outlines, 2)), np.empty((outlines, 2))
    for p in range(outlines):
        for axis in range(2):
            low[p, axis] = corners[start[p] : start[p + 1], axis].min()
            high[p, axis] = corners[start[p] : start[p + 1], axis].max()
    enter, leave = np.empty(outlines), np.empty(outlines)
    for p in range(outlines):
        for c in range(start[p], start[p + 1]):
            a, b = corners[c], corners[c + 1 if c + 1 < start[p + 1] else start[p]]
            hidden = 0
            for q in range(outlines):
                if q == p or not _near(a, b, low[q], high[q]):
                    continue
                first, last = _inside(a, b, corners[start[q] : start[q + 1]])
                if first < last:
                    enter[hidden], leave[hidden] = first, last
                    hidden += 1
            order = np.argsort(enter[:hidden])
            least = _LEAST_M / max(np.hypot(b[0] - a[0], b[1] - a[1]), 1e-9)
            at = 0.0
            for k in range(hidden + 1):
                until = enter[order[k]] if k < hidden else 1.0
                if until - at > least:
                    if count == len(ends):
                        ends = np.concatenate((ends, np.empty_like(ends)))
                    ends[count, 0], ends[count, 1] = a + at * (b - a), a + until * (b - a)
                    count += 1
                if k < hidden:
                    at = max(at, leave[order[k]])
    return ends[:count]


@njit(cache=True, nogil=True)
def _near(a: Floats, b: Floats, low: Floats, high: Floats) -> bool:
    """Return whether the rectangle around a line from a to b meets another one."""
    beside = max(a[0], b[0]) < low[0] or min(a[0], b[0]) > high[0]
    return not (beside or max(a[1], b[1]) < low[1] or min(a[1], b[1]) > high[1])


@njit(cache=True, nogil=True)
def _inside(a: Floats, b: Floats, outline: Floats) -> tuple[float, float]:
    """Return the shares of a line from a to b between which it is inside a convex outline (Cyrus and Beck 1978)."""
    first, last = 0.0, 1.0
    for k in range(len(outline)):
        here, there = outline[k], outline[(k + 1) % len(outline)]
        ex, ey = there[0] - here[0], there[1] - here[1]
        within = _WITHIN_M * np.hypot(ex, ey)
        at_a = ex * (a[1] - here[1]) - ey * (a[0] - here[0]) - within
        at_b = ex * (b[1] - here[1]) - ey * (b[0] - here[0]) - within
        if at_a < 0 and at_b < 0:
            return 1.0, 0.0
        if at_a < 0:
            first = max(first, at_a / (at_a - at_b))
        elif at_b < 0:
            last = min(last, at_a / (at_a - at_b))
    return first, last
