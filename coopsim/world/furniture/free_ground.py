"""Free ground of a place: furniture is put where nothing stands, drives, rides or walks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask

GROUND, CROWN, BULKY, UNPAVED = 1, 2, 4, 8
"""Layers: what stands on the ground, what spreads above it, what hides people who are about to cross, and what does
not stand in yards and driveways."""

_CELL_M = 16.0
_LARGEST_M = 4.0
"""Radius of the largest disc that is asked about."""


class Obstacles(NamedTuple):
    """K convex outlines that must stay free, with a margin; two points are a line, one is a disc.

    Attributes:
        corners: (C, 2) m of all outlines.
        starts: (K + 1,) first corner of each.
        margin_m: (K,) around them.
        layers: (K,) that they concern.
        cell_starts: (X * Y + 1,) where the obstacles near each cell of a grid begin.
        near: their numbers.
        origin_m: (2,) of the grid.
        shape: its numbers of cells, (2,).
    """

    corners: Floats
    starts: Ints
    margin_m: Floats
    layers: Ints
    cell_starts: Ints
    near: Ints
    origin_m: Floats
    shape: Ints


class Discs(NamedTuple):
    """Discs that pieces of furniture cover.

    Attributes:
        middle_m: (P, 2).
        radius_m: (P,).
        layers: (P,) that they are in.
    """

    middle_m: Floats
    radius_m: Floats
    layers: Ints


class Wishes(NamedTuple):
    """N pieces that are wished for, in order of preference.

    Attributes:
        discs: of all pieces.
        starts: (N + 1,) first disc of each piece.
        choice: (N,) of the pieces with one number, which follow each other, only the first that fits is put up.
        run: (N,) pieces with one number may touch; -1: none.
    """

    discs: Discs
    starts: Ints
    choice: Ints
    run: Ints


def make_obstacles(outlines: list[Floats], margin_m: list[float], layers: list[int], area: Floats) -> Obstacles:
    """Sort outlines (each (K, 2) m, convex) into a grid over an area, its least and greatest x and y (2, 2) m."""
    corners = np.concatenate([np.zeros((0, 2)), *outlines])
    starts = np.cumsum([0, *(len(outline) for outline in outlines)])
    origin = area[0] - _CELL_M
    shape = np.ceil((area[1] + _CELL_M - origin) / _CELL_M).astype(np.int64)
    margins = np.array(margin_m, dtype=np.float64)
    counts, near = _sorted_into_cells(corners, starts, margins, origin, shape)
    return Obstacles(corners, starts, margins, np.array(layers, dtype=np.int64), counts, near, origin, shape)


@njit(cache=True, nogil=True)
def _sorted_into_cells(
    corners: Floats, starts: Ints, margin_m: Floats, origin: Floats, shape: Ints
) -> tuple[Ints, Ints]:
    """Return where each cell's obstacles begin, and their numbers."""
    count = len(starts) - 1
    first, last = np.empty((count, 2), np.int64), np.empty((count, 2), np.int64)
    cell_starts = np.zeros(shape[0] * shape[1] + 1, np.int64)
    for k in range(count):
        for axis in range(2):
            low, high = np.inf, -np.inf
            for c in range(starts[k], starts[k + 1]):
                low, high = min(low, corners[c, axis]), max(high, corners[c, axis])
            reach = margin_m[k] + _LARGEST_M
            first[k, axis] = min(max(np.floor((low - reach - origin[axis]) / _CELL_M), 0), shape[axis])
            last[k, axis] = min(max(np.floor((high + reach - origin[axis]) / _CELL_M) + 1, 0), shape[axis])
        for i in range(first[k, 0], last[k, 0]):
            for j in range(first[k, 1], last[k, 1]):
                cell_starts[i * shape[1] + j + 1] += 1
    for cell in range(len(cell_starts) - 1):
        cell_starts[cell + 1] += cell_starts[cell]
    near, filled = np.empty(cell_starts[-1], np.int64), cell_starts.copy()
    for k in range(count):
        for i in range(first[k, 0], last[k, 0]):
            for j in range(first[k, 1], last[k, 1]):
                near[filled[i * shape[1] + j]] = k
                filled[i * shape[1] + j] += 1
    return cell_starts, near


@njit(cache=True, nogil=True)
def settle(wishes: Wishes, obstacles: Obstacles, standing: Discs, gap_m: float) -> Mask:
    """Decide which pieces fit, one after the other.

    Args:
        wishes: the pieces.
        obstacles: outlines that must stay free. Pieces beyond their grid do not fit.
        standing: discs of what has been put up before.
        gap_m: between two pieces on the ground.

    Returns:
        The mask (N,) of the pieces that fit.
    """
    discs, starts = wishes.discs, wishes.starts
    fits = np.zeros(len(starts) - 1, np.bool_)
    chosen = -1
    for n in range(len(fits)):
        if wishes.choice[n] >= 0 and wishes.choice[n] == chosen:
            continue
        free = True
        for p in range(starts[n], starts[n + 1]):
            spot, radius, layers = discs.middle_m[p], discs.radius_m[p], discs.layers[p]
            if not _is_free(spot, radius, layers, obstacles) or _touches(spot, radius, layers, standing, gap_m):
                free = False
                break
            for m in range(n):
                if not fits[m] or (wishes.run[n] >= 0 and wishes.run[n] == wishes.run[m]):
                    continue
                for q in range(starts[m], starts[m + 1]):
                    apart = radius + discs.radius_m[q] + gap_m
                    dx, dy = spot[0] - discs.middle_m[q, 0], spot[1] - discs.middle_m[q, 1]
                    if layers & discs.layers[q] & (GROUND | CROWN) and dx * dx + dy * dy < apart * apart:
                        free = False
            if not free:
                break
        if free:
            fits[n], chosen = True, wishes.choice[n]
    return fits


@njit(cache=True, nogil=True)
def _touches(spot: Floats, radius: float, layers: int, standing: Discs, gap_m: float) -> bool:
    for q in range(len(standing.radius_m)):
        apart = radius + standing.radius_m[q] + gap_m
        dx, dy = spot[0] - standing.middle_m[q, 0], spot[1] - standing.middle_m[q, 1]
        if layers & standing.layers[q] & (GROUND | CROWN) and dx * dx + dy * dy < apart * apart:
            return True
    return False


@njit(cache=True, nogil=True)
def are_free(spots: Floats, radius_m: float, layers: int, obstacles: Obstacles) -> Mask:
    """Return the mask (N,) of the discs around points (N, 2) m that keep the margins of all obstacles in layers."""
    free = np.zeros(len(spots), np.bool_)
    for n in range(len(spots)):
        free[n] = _is_free(spots[n], radius_m, layers, obstacles)
    return free


@njit(cache=True, nogil=True)
def _is_free(spot: Floats, radius: float, layers: int, obstacles: Obstacles) -> bool:
    """Return whether a disc keeps the margins of all obstacles in its layers."""
    i, j = np.floor((spot[0] - obstacles.origin_m[0]) / _CELL_M), np.floor((spot[1] - obstacles.origin_m[1]) / _CELL_M)
    if not (0 <= i < obstacles.shape[0] and 0 <= j < obstacles.shape[1]):
        return False
    cell = int(i) * obstacles.shape[1] + int(j)
    for n in range(obstacles.cell_starts[cell], obstacles.cell_starts[cell + 1]):
        k = obstacles.near[n]
        if not layers & obstacles.layers[k]:
            continue
        if distance_to(spot, obstacles.corners, obstacles.starts[k], obstacles.starts[k + 1]) < (
            obstacles.margin_m[k] + radius
        ):
            return False
    return True


@njit(cache=True, nogil=True)
def distance_to(spot: Floats, corners: Floats, first: int, end: int) -> float:
    """Return the distance of a point (2,) from the convex outline of `corners` `first` to `end`; 0 inside of it."""
    left, right, nearest = False, False, np.inf
    for c in range(first, end):
        after = c + 1 if c + 1 < end else first
        ex, ey = corners[after, 0] - corners[c, 0], corners[after, 1] - corners[c, 1]
        dx, dy = spot[0] - corners[c, 0], spot[1] - corners[c, 1]
        turn, length2 = ex * dy - ey * dx, ex * ex + ey * ey
        left, right = left or turn > 0, right or turn < 0
        along = min(max((dx * ex + dy * ey) / length2, 0.0), 1.0) if length2 > 0 else 0.0
        nearest = min(nearest, exact.hypot(dx - along * ex, dy - along * ey))
    inside = end - first > 2 and not (left and right)
    return 0.0 if inside else nearest
