"""Where things are while a LiDAR turns: it does not see everything at one time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.sensors.lidar.cast.raster_kernel import LANES
from coopsim.sensors.lidar.cast.ray_grid import Grid, GridHits
from coopsim.sensors.scene import Triangles
from coopsim.types import Ints

SECTORS = 32
"""In how many steps a turn is taken: at 20 m/s and 10 turns a second, nothing is more than 3 cm off in time."""


def between(start: SE3, end: SE3, share: float) -> SE3:
    """The gravity-aligned pose at a share of the way from one to another; below 0, on the way there."""
    turned = float(wrap_angle(end.yaw - start.yaw))
    return SE3.from_xyz_yaw(
        start.translation + share * (end.translation - start.translation), start.yaw + share * turned
    )


def earlier(triangles: Triangles, seconds: float) -> Triangles:
    """The scene as it was, if all that moves did so as it does now, straight ahead."""
    if triangles.parts is None or triangles.velocity is None:
        raise InvalidValueError("a scene whose parts have no velocity has no earlier time; make it with SceneGeometry")
    moved = np.repeat(triangles.velocity, np.diff(triangles.parts.vertex_start), axis=0)
    vertices = triangles.vertices.copy()
    vertices[:, :2] -= seconds * moved
    return replace(triangles, vertices=vertices)


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn of a LiDAR, in sectors; each is seen as things are at the middle of its time.

    Attributes:
        start: the agent's pose at its start.
        end: the agent's pose at its end.
        base_SE3_sensor: where the sensor is on the agent.
        seconds: that it takes.
        sectors: number of parts.
        columns: of the grid.
        blocks: of `LANES` columns, of which sectors are made.
    """

    start: SE3
    end: SE3
    base_SE3_sensor: SE3
    seconds: float
    sectors: int
    columns: int
    blocks: int

    def world_SE3_sensor(self, sector: int) -> SE3:
        """The sensor's pose in a sector; in an only one, that at the end."""
        if self.seconds == 0:
            return self.end.compose(self.base_SE3_sensor)
        return between(self.start, self.end, self._share(sector)).compose(self.base_SE3_sensor)

    def cast(self, grid: Grid, triangles: Triangles, threads: int) -> GridHits:
        """All rays of a grid, each in its sector's time."""
        if self.seconds == 0:
            return grid.cast(triangles, self.world_SE3_sensor(0), threads)
        hits, ends = grid.room(), self._ends
        for k in range(self.sectors):
            then = earlier(triangles, (1.0 - self._share(k)) * self.seconds)
            grid.cast_sector(then, self.world_SE3_sensor(k), (ends[k], ends[k + 1]), hits, threads)
        return hits

    def poses(self, world_SE3_base: SE3) -> tuple[Floats, Floats, Ints]:
        """The sensor's poses in a base frame, (S, 3, 3) and (S, 3), and the sector of each column (C,)."""
        if self.seconds == 0:
            sector = np.zeros(self.columns, dtype=np.int64)
        else:
            sector = np.searchsorted(self._ends, np.arange(self.columns) // LANES, side="right") - 1
        base_SE3_world = world_SE3_base.inverse()
        poses = [base_SE3_world.compose(self.world_SE3_sensor(k)) for k in range(self.sectors)]
        return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses]), sector

    @property
    def _ends(self) -> list[int]:
        ends: list[int] = np.linspace(0, self.blocks, self.sectors + 1).astype(int).tolist()
        return ends

    def _share(self, sector: int) -> float:
        """Which share of the turn has passed in the middle of a sector."""
        ends = self._ends
        return min((ends[sector] + ends[sector + 1]) / 2 * LANES / self.columns, 1.0)
