"""The ground near each point: cell by cell outwards from the agent, on planes that follow slopes of up to a fifth.

A cell's lowest point is on the ground if it lies near the plane through cells that are nearer to the agent. Where there
is none, as behind a parked car or far away between two beams, the plane goes on, and becomes flatter. At last each cell
takes the plane through what is known on all its sides. Growing from the sensor outwards: Himmelsbach, von Hundelshausen
and Wuensche, "Fast segmentation of 3D point clouds for ground vehicles", IV 2010; they grow lines in sectors.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from coopsim.nn.detector.ground import between
from coopsim.support.kernels import njit
from coopsim.types import Ints

_CELL_M, _CELLS = 3.2, 67  # to 107.2 m on each side; the agent stands in the middle of a cell
_LOW = -_CELL_M * _CELLS / 2
_REACH = 2  # cells on each side through which a plane goes
_STEEPEST = 0.2  # few streets are steeper
_ABOVE_M, _BELOW_M, _DRIFT_M = 0.3, 0.35, 0.03  # a slope may begin within a cell; more where less is known
_GUESSED = 0.05  # weight of cells without a point on the ground
_STIFF, _FLATTER = 2.0, 0.97  # pull on a slope towards those of the cells before, in cells^2, and their decay
_NEAR, _ON_M, _TRIED = 4, 0.2, np.arange(-10, 11) * (_STEEPEST * _CELL_M / 10)  # the first slope: cells, slopes a cell
_ENOUGH = 60_000  # points of which the lowest are sought


def local_ground(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the height (P,) m of the ground under each of the points (P, >= 3) x, y, z m.

    The agent is at the origin, and the ground under it at z = 0. Beyond 107 m the ground stays as high as at the rim.
    """
    lowest = _lowest(np.ascontiguousarray(points[:: max(1, len(points) // _ENOUGH)]))
    heights = _smoothed(*_grown(lowest, _outwards(), *_first_slope(lowest)))
    under: NDArray[np.float32] = between(points, heights, _CELL_M)
    return under


@cache
def _outwards() -> Ints:
    """Return the numbers of all cells, the nearest to the agent first."""
    steps = np.arange(_CELLS) - _CELLS // 2
    return np.argsort((steps[:, None] ** 2 + steps**2).ravel(), kind="stable")


@njit(cache=True, nogil=True)
def _lowest(points):  # type: ignore[no-untyped-def]
    """Return the lowest point (N, N, 3) of each cell, x and y in cells, z in m; z is infinite where there is none."""
    lowest = np.full((_CELLS, _CELLS, 3), np.inf)
    for k in range(len(points)):
        x, y, z = (points[k, 0] - _LOW) / _CELL_M, (points[k, 1] - _LOW) / _CELL_M, points[k, 2]
        i, j = int(np.floor(y)), int(np.floor(x))
        if 0 <= i < _CELLS and 0 <= j < _CELLS and z < lowest[i, j, 2]:
            lowest[i, j, 0], lowest[i, j, 1], lowest[i, j, 2] = x - 0.5, y - 0.5, z
    return lowest


@njit(cache=True, nogil=True)
def _plane(known, weight, i, j, slope_x, slope_y):  # type: ignore[no-untyped-def]
    """Return height, slope along x and along y, m a cell, at cell (i, j) of the plane through what is known around it.

    Its slopes are pulled towards those given.
    """
    total = mean_x = mean_y = mean_z = 0.0
    rows = range(max(i - _REACH, 0), min(i + _REACH + 1, _CELLS))
    columns = range(max(j - _REACH, 0), min(j + _REACH + 1, _CELLS))
    for a in rows:
        for b in columns:
            w = weight[a, b] / (1 + (a - i) ** 2 + (b - j) ** 2)
            total += w
            mean_x += w * (known[a, b, 0] - j)
            mean_y += w * (known[a, b, 1] - i)
            mean_z += w * known[a, b, 2]
    if total == 0:
        return 0.0, slope_x, slope_y
    mean_x, mean_y, mean_z = mean_x / total, mean_y / total, mean_z / total
    xx = yy = _STIFF
    xy, xz, yz = 0.0, _STIFF * slope_x, _STIFF * slope_y
    for a in rows:
        for b in columns:
            w = weight[a, b] / (1 + (a - i) ** 2 + (b - j) ** 2)
            x, y, z = known[a, b, 0] - j - mean_x, known[a, b, 1] - i - mean_y, known[a, b, 2] - mean_z
            xx, yy, xy, xz, yz = xx + w * x * x, yy + w * y * y, xy + w * x * y, xz + w * x * z, yz + w * y * z
    size = xx * yy - xy * xy
    along_x, along_y = (xz * yy - yz * xy) / size, (yz * xx - xz * xy) / size
    shorter = min(1.0, _STEEPEST * _CELL_M / max(np.hypot(along_x, along_y), 1e-9))
    along_x, along_y = shorter * along_x, shorter * along_y
    return mean_z - along_x * mean_x - along_y * mean_y, along_x, along_y


@njit(cache=True, nogil=True)
def _first_slope(lowest):  # type: ignore[no-untyped-def]
    """Return the slopes along x and y, m a cell, of the plane under the agent on which most cells near it have points.

    Of equally good ones it is the flattest.
    """
    middle, best, found_x, found_y = _CELLS // 2, -np.inf, 0.0, 0.0
    for slope_x in _TRIED:
        for slope_y in _TRIED:
            good = -1e-3 * np.hypot(slope_x, slope_y)
            for i in range(middle - _NEAR, middle + _NEAR + 1):
                for j in range(middle - _NEAR, middle + _NEAR + 1):
                    if lowest[i, j, 2] < np.inf:
                        x, y = lowest[i, j, 0] - middle, lowest[i, j, 1] - middle
                        good += max(0.0, 1 - ((lowest[i, j, 2] - slope_x * x - slope_y * y) / _ON_M) ** 2)
            if good > best:
                best, found_x, found_y = good, slope_x, slope_y
    return found_x, found_y


@njit(cache=True, nogil=True)
def _grown(lowest, outwards, first_x, first_y):  # type: ignore[no-untyped-def]
    """Return places (N, N, 3) on the ground, x and y in cells, z in m, their weights (N, N), and slopes (N, N, 2).

    Slopes are in m a cell; those under the agent are the first.
    """
    middle = _CELLS // 2
    known, weight, slopes = np.zeros((_CELLS, _CELLS, 3)), np.zeros((_CELLS, _CELLS)), np.zeros((_CELLS, _CELLS, 2))
    unsure = np.zeros((_CELLS, _CELLS))  # cells in a row without a point on the ground
    for cell in outwards:
        i, j = cell // _CELLS, cell % _CELLS
        known[i, j, 0], known[i, j, 1] = j, i
        if i == middle and j == middle:
            weight[i, j], slopes[i, j, 0], slopes[i, j, 1] = 1.0, first_x, first_y
            continue
        slope_x = slope_y = total = far = 0.0
        for a in range(max(i - 1, 0), min(i + 2, _CELLS)):
            for b in range(max(j - 1, 0), min(j + 2, _CELLS)):
                if weight[a, b] > 0:
                    w = weight[a, b]
                    slope_x, slope_y = slope_x + w * slopes[a, b, 0], slope_y + w * slopes[a, b, 1]
                    total, far = total + w, far + w * unsure[a, b]
        slope_x, slope_y, far = _FLATTER * slope_x / total, _FLATTER * slope_y / total, far / total
        height, along_x, along_y = _plane(known, weight, i, j, slope_x, slope_y)
        slopes[i, j, 0], slopes[i, j, 1] = along_x, along_y
        away = np.inf
        if lowest[i, j, 2] < np.inf:
            away = lowest[i, j, 2] - height - along_x * (lowest[i, j, 0] - j) - along_y * (lowest[i, j, 1] - i)
        if -_BELOW_M - _DRIFT_M * far < away < _ABOVE_M + _DRIFT_M * far:
            known[i, j], weight[i, j] = lowest[i, j], 1.0
        else:
            known[i, j, 2], weight[i, j], unsure[i, j] = height, _GUESSED, far + 1
    return known, weight, slopes


@njit(cache=True, nogil=True)
def _smoothed(known, weight, slopes):  # type: ignore[no-untyped-def]
    """Return the heights (N, N) m of the ground in the middles of cells, by what is known on all sides."""
    heights = np.empty((_CELLS, _CELLS), np.float32)
    for i in range(_CELLS):
        for j in range(_CELLS):
            heights[i, j] = _plane(known, weight, i, j, slopes[i, j, 0], slopes[i, j, 1])[0]
    return heights
