"""Memory that sweeps use in turn: what the last one wrote to is still in the processor's cache."""

from __future__ import annotations

from operator import ge
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from coopsim.sensors.lidar.cast.raster_kernel import Canvas
from coopsim.sensors.lidar.cast.triangle_setup import Corners, Scene, Shapes

_CACHE_LINE_BYTES = 64


class Room(NamedTuple):
    """What a sweep writes on its way.

    Attributes:
        corners: for the scene's vertices or more.
        shapes: for its faces and parts or more.
        canvas: for the rays or more, in one row.
    """

    corners: Corners
    shapes: Shapes
    canvas: Canvas

    def canvas_of(self, rows: int, columns: int) -> Canvas:
        """The canvas as a grid without gaps: rows that are far apart would compete for the same places in a cache."""
        nearness, owner = self.canvas
        rays = rows * columns
        return Canvas(nearness[:rays].reshape(rows, columns), owner[:rays].reshape(rows, columns))

    @property
    def size(self) -> tuple[int, int, int, int]:
        """For how many vertices, faces, parts and rays there is room."""
        corners, shapes, canvas = self
        return len(corners.slope), len(shapes.face), len(shapes.counts), len(canvas.owner)


class Rooms:
    """Those that no sweep uses at the moment; any thread may take one."""

    def __init__(self) -> None:
        self._free: list[Room] = []

    def take(self, scene: Scene, rays: int) -> Room:
        """One in which a scene and so many rays fit, for the taker alone."""
        need = len(scene.vertices), len(scene.faces), len(scene.parts.closed), rays
        try:
            room = self._free.pop()
        except IndexError:
            return _make(*need)
        return room if all(map(ge, room.size, need)) else _make(*map(max, room.size, need))

    def give_back(self, room: Room) -> None:
        """For sweeps to come, once no thread uses it any more."""
        self._free.append(room)


def _make(vertices: int, faces: int, parts: int, rays: int) -> Room:
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
    return Room(corners, shapes, Canvas(aligned(rays, np.float32), aligned(rays, np.int32)))


def aligned(count: int, dtype: DTypeLike) -> NDArray[Any]:
    """An empty array (count,) that begins where a line of the processor's cache does."""
    size = count * np.dtype(dtype).itemsize
    memory = np.empty(size + _CACHE_LINE_BYTES, np.uint8)
    first = -memory.ctypes.data % _CACHE_LINE_BYTES
    return memory[first : first + size].view(dtype)
