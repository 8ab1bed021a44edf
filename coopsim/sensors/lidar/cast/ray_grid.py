"""A LiDAR's sweep as a picture: all rays of a spinning sensor at once, by drawing every triangle into their grid.

The grid is the sensor's own, so any mounting is as good as a level one. There is nothing to build when things move.
Embree (`coopsim.sensors.raycast`) casts any rays, one by one; here they must be those of a beam table.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import partial

import numpy as np

from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.cast.grid_job import BANDS_DRAWN, Job, follow, lead
from coopsim.sensors.lidar.cast.grid_room import Rooms, aligned
from coopsim.sensors.lidar.cast.raster_kernel import LANES, Beams
from coopsim.sensors.lidar.cast.triangle_setup import Scene, Singles
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import Parts, Triangles
from coopsim.support.threads import work_together
from coopsim.types import Ints

_RUNS = 16
"""In how many pieces threads that share a sweep set up the scene."""

_ROOMS = Rooms()


@dataclass(frozen=True, slots=True, eq=False)
class GridHits:
    """Where the rays of B beams and C columns end, in the order of the beam table.

    Attributes:
        range_m: (B, C) float32, inf where nothing was hit.
        face: (B, C) int, index of the face, -1 where nothing was hit.
        cosine: (B, C) float32, of the angle between ray and surface normal, in [0, 1]; 0 where nothing was hit.
    """

    range_m: Singles
    face: Ints
    cosine: Singles


class Grid(ABC):
    """The rays of a beam table, ready to be cast, all at one time or by sectors.

    Args:
        pattern: the beams.
        columns: firings per turn.
    """

    def __init__(self, pattern: BeamPattern, columns: int) -> None:
        self._shape = len(pattern.elevation_rad), columns

    def cast(self, triangles: Triangles, world_SE3_sensor: SE3, threads: int = 1) -> GridHits:
        """Cast all rays, at one time.

        Args:
            triangles: the scene.
            world_SE3_sensor: the sensor's pose, any roll and pitch.
            threads: that share the work; the result does not depend on it.
        """
        hits = self.room()
        self.cast_sector(triangles, world_SE3_sensor, (0, self.blocks), hits, threads)
        return hits

    def room(self) -> GridHits:
        """Room for the hits of all rays."""
        return GridHits(
            np.empty(self._shape, np.float32), np.empty(self._shape, np.int64), np.empty(self._shape, np.float32)
        )

    @property
    def blocks(self) -> int:
        """Number of blocks of `LANES` columns (the last may be shorter), of which sectors are made."""
        return -(-self._shape[1] // LANES)

    @abstractmethod
    def cast_sector(
        self, triangles: Triangles, world_SE3_sensor: SE3, blocks: tuple[int, int], hits: GridHits, threads: int = 1
    ) -> None:
        """Cast the rays of some blocks of columns, from the first to before the last of `blocks`, into `hits`."""


class RayGrid(Grid):
    """The grid of compiled kernels, whose work is shared by one thread for each beam at most.

    Closed parts (see `Parts`) are seen from outside; where the sensor is in the box around one, and for open ones, both
    sides of a triangle are. Where two triangles are equally near, the first is hit.
    """

    def __init__(self, pattern: BeamPattern, columns: int) -> None:
        super().__init__(pattern, columns)
        order = np.argsort(-pattern.elevation_rad, kind="stable")
        tangent, shift_rad = np.tan(pattern.elevation_rad[order]), pattern.offset_rad[order]
        azimuth = np.arange(self.blocks * LANES) * (2 * np.pi / columns)
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        table = aligned(2 * len(azimuth), np.float32).reshape(2, -1)
        table[:] = cos, sin
        self._beams = Beams(
            tangent.astype(np.float32),
            shift_rad.astype(np.float32),
            table[0],
            table[1],
            columns,
            order,
            (tangent, np.cos(shift_rad), np.sin(shift_rad), cos, sin),
        )

    def cast_sector(
        self, triangles: Triangles, world_SE3_sensor: SE3, blocks: tuple[int, int], hits: GridHits, threads: int = 1
    ) -> None:
        rotation = np.ascontiguousarray(world_SE3_sensor.rotation)
        parts = triangles.parts or _one_part(triangles)
        scene = Scene(triangles.vertices, triangles.faces, parts, rotation, world_SE3_sensor.translation)
        rows, columns = len(self._beams.order), (blocks[1] - blocks[0]) * LANES
        room, out = _ROOMS.take(scene, rows * columns), (hits.range_m, hits.face, hits.cosine)
        threads = min(threads, rows)
        canvas, pieces = room.canvas_of(rows, columns), (1, 1) if threads == 1 else (_RUNS, threads)
        progress = np.zeros(BANDS_DRAWN + pieces[1], np.int64)
        job = Job(scene, self._beams, blocks, room.corners, room.shapes, canvas, out, pieces, progress)
        work_together(partial(lead, job), partial(follow, job), threads)
        _ROOMS.give_back(room)


def _one_part(triangles: Triangles) -> Parts:
    return Parts(np.array([0, len(triangles.faces)]), np.array([0, len(triangles.vertices)]), np.zeros(1, np.bool_))
