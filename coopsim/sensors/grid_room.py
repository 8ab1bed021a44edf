"""Memory for sweeps, used again: whatever sweeps are made of is as large as the scene, or as the grid."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from coopsim.sensors.grid_kernel import Canvas
from coopsim.sensors.grid_shapes import Corners, Scene, Shapes

_CACHE_LINE_BYTES = 64


class Room(NamedTuple):
    """What a sweep writes on its way.

    Attributes:
        corners: for the scene's vertices or more.
        shapes: for its faces and parts or more.
        canvas: for all rays.
    """

    corners: Corners
    shapes: Shapes
    canvas: Canvas


class Rooms:
    """Rooms that no sweep uses at the moment; any thread may take one.

    Args:
        rows: of the canvas.
        columns: of the canvas, a multiple of `LANES`.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self._grid = rows, columns
        self._free: list[Room] = []

    def take(self, scene: Scene) -> Room:
        """One in which a scene fits, for the taker alone."""
        size = len(scene.vertices), len(scene.faces), len(scene.parts.closed)
        try:
            room = self._free.pop()
        except IndexError:
            return self._make(*size)
        has = len(room.corners.local), len(room.shapes.face), len(room.shapes.counts)
        return room if all(np.greater_equal(has, size)) else self._make(*size)

    def give_back(self, room: Room) -> None:
        """For sweeps to come, once no thread uses it any more."""
        self._free.append(room)

    def _make(self, vertices: int, faces: int, parts: int) -> Room:
        shapes = Shapes(
            np.empty(parts, np.int64),
            np.empty((faces, 9), np.float32),
            np.empty((faces, 3)),
            np.empty(faces, np.float32),
            np.empty((faces, 2), np.float32),
            np.empty((faces, 2), np.int32),
            np.empty(faces, np.int64),
        )
        corners = Corners(np.empty((vertices, 3)), np.empty(vertices, np.float32), np.empty(vertices, np.float32))
        return Room(corners, shapes, Canvas(aligned(self._grid, np.float32), aligned(self._grid, np.int32)))


def aligned(shape: tuple[int, int], dtype: DTypeLike) -> NDArray[Any]:
    """An empty array that begins where a line of the processor's cache does."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + _CACHE_LINE_BYTES, np.uint8)
    first = -memory.ctypes.data % _CACHE_LINE_BYTES
    return memory[first : first + size].view(dtype).reshape(shape)
