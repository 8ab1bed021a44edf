"""Painting boxes, points and a map into a picture around an agent.

Planes (C, H, W) uint8 of squares (H = W); row 0 is farthest ahead, column 0 farthest to the left; a pixel is `pixel_m`
wide, and the agent stands where the four middle ones meet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

Planes = NDArray[np.uint8]

LOWEST_M, HIGHEST_M = -1.0, 5.0
"""Heights of points that are shown as the least and the largest brightness."""

MANY_POINTS = 64
"""Number of points of a pixel from which it is as bright as can be."""


@njit(cache=True, nogil=True)
def paint_boxes(planes: Planes, boxes: Floats, values: Planes, pixel_m: float) -> None:
    """Fill the footprints of boxes (N, 7), one after another, each with its values (N, C), a plane each.

    The pixel under a box's centre is filled, however small the box.
    """
    size = planes.shape[1]
    for n in range(len(boxes)):
        x, y, half_l, half_w = boxes[n, 0], boxes[n, 1], boxes[n, 3] / 2, boxes[n, 4] / 2
        cos, sin = np.cos(boxes[n, 6]), np.sin(boxes[n, 6])
        reach_x, reach_y = abs(cos) * half_l + abs(sin) * half_w, abs(sin) * half_l + abs(cos) * half_w
        middle_row, middle_column = size / 2 - x / pixel_m, size / 2 - y / pixel_m
        for row in _span(middle_row, reach_x / pixel_m, size):
            for column in _span(middle_column, reach_y / pixel_m, size):
                ahead, left = (middle_row - row - 0.5) * pixel_m, (middle_column - column - 0.5) * pixel_m
                inside = abs(ahead * cos + left * sin) <= half_l and abs(left * cos - ahead * sin) <= half_w
                if inside or (row == np.floor(middle_row) and column == np.floor(middle_column)):
                    for plane in range(len(planes)):
                        planes[plane, row, column] = values[n, plane]


@njit(cache=True, nogil=True)
def paint_points(planes: Planes, points: Floats, pixel_m: float) -> None:
    """Paint points (N, 3): the logarithm of their number in the first plane, the highest one's height in the second."""
    size = planes.shape[1]
    counts, highest = np.zeros((size, size), np.int64), np.full((size, size), LOWEST_M)
    for n in range(len(points)):
        row, column = np.floor(size / 2 - points[n, 0] / pixel_m), np.floor(size / 2 - points[n, 1] / pixel_m)
        if 0 <= row < size and 0 <= column < size:
            counts[int(row), int(column)] += 1
            highest[int(row), int(column)] = max(highest[int(row), int(column)], points[n, 2])
    for row in range(size):
        for column in range(size):
            if counts[row, column]:
                density = min(1.0, np.log1p(counts[row, column]) / np.log1p(MANY_POINTS))
                height = (highest[row, column] - LOWEST_M) / (HIGHEST_M - LOWEST_M)
                planes[0, row, column] = np.uint8(255 * density)
                planes[1, row, column] = np.uint8(255 * min(1.0, height))


@njit(cache=True, nogil=True)
def paint_map(planes: Planes, cells: Planes, origin_m: Floats, cell_m: float, pose: Floats, pixel_m: float) -> None:
    """Look the map up under each pixel: bit k of its cell is plane k.

    Args:
        planes: to paint.
        cells: (H, W), the map's bitmap in the world frame.
        origin_m: (2,) x, y of the bitmap's first cell.
        cell_m: size of its cells.
        pose: (4,) x, y, z m and heading rad of the agent in the world frame.
        pixel_m: size of a pixel.
    """
    size = planes.shape[1]
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    for row in range(size):
        ahead = (size / 2 - row - 0.5) * pixel_m
        for column in range(size):
            left = (size / 2 - column - 0.5) * pixel_m
            x = np.floor((pose[0] + ahead * cos - left * sin - origin_m[0]) / cell_m)
            y = np.floor((pose[1] + ahead * sin + left * cos - origin_m[1]) / cell_m)
            if 0 <= x < cells.shape[1] and 0 <= y < cells.shape[0]:
                cell = cells[int(y), int(x)]
                for plane in range(len(planes)):
                    planes[plane, row, column] = 255 * ((cell >> plane) & 1)


@njit(cache=True, nogil=True)
def _span(middle: float, reach: float, size: int) -> range:
    """Return the pixels of an axis that a box may touch."""
    first, last = np.floor(middle - reach), np.floor(middle + reach)
    return range(int(max(first, 0.0)), int(min(last, size - 1.0)) + 1)
