"""Motion during a LiDAR's revolution: it does not see everything at one time."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.sensors.lidar.cast.raster_kernel import LANES
from coopsim.sensors.lidar.cast.ray_grid import GridHits, RayGrid
from coopsim.sensors.scene import Triangles
from coopsim.types import Ints

SECTORS = 32
"""Steps that a revolution is taken in: at 20 m/s and 10 revolutions a second, nothing is off by more than 3 cm."""


def interpolate(start: SE3, end: SE3, fraction: float) -> SE3:
    """Return the gravity-aligned pose at a fraction of the way between two poses; extrapolate below 0 and above 1."""
    turned = float(wrap_angle(end.yaw - start.yaw))
    return SE3.from_xyz_yaw(
        start.translation + fraction * (end.translation - start.translation), start.yaw + fraction * turned
    )


def earlier(triangles: Triangles, seconds: float) -> Triangles:
    """Return the scene as it was some seconds ago, taking all velocities as constant.

    Raises:
        InvalidValueError: the scene's parts have no velocity.
    """
    if triangles.parts is None or triangles.velocity is None:
        raise InvalidValueError("a scene whose parts have no velocity has no earlier time; make it with SceneGeometry")
    moved = np.repeat(triangles.velocity, np.diff(triangles.parts.vertex_start), axis=0)
    vertices = triangles.vertices.copy()
    vertices[:, :2] -= seconds * moved
    return replace(triangles, vertices=vertices)


class Revolution:
    """One revolution of a LiDAR, in S sectors; each sees the scene as it is at the middle of the sector's time.

    Args:
        start: the agent's pose at the start of the revolution.
        end: the agent's pose at its end.
        base_SE3_sensor: the sensor's pose on the agent.
        duration_s: of the revolution; 0: all rays are cast at its end.
        columns: firings per revolution, C.
    """

    def __init__(self, start: SE3, end: SE3, base_SE3_sensor: SE3, duration_s: float, columns: int) -> None:
        blocks = -(-columns // LANES)
        sectors = min(SECTORS, blocks) if duration_s > 0 else 1
        self._ends: list[int] = np.linspace(0, blocks, sectors + 1).astype(int).tolist()
        self._columns = columns
        middles = [min((first + last) / 2 * LANES / columns, 1.0) for first, last in pairwise(self._ends)]
        at = [interpolate(start, end, middle) for middle in middles] if duration_s > 0 else [end]
        self._ages_s = [(1.0 - middle) * duration_s for middle in middles]
        self.world_SE3_sensor = [pose.compose(base_SE3_sensor) for pose in at]
        """The sensor's pose in each sector."""

    def cast(self, grid: RayGrid, triangles: Triangles) -> GridHits:
        """Cast all rays of a grid, each at its sector's time; `triangles` is the scene at the end."""
        hits = grid.empty_hits()
        for blocks, age_s, pose in zip(pairwise(self._ends), self._ages_s, self.world_SE3_sensor, strict=True):
            grid.cast_sector(earlier(triangles, age_s) if age_s > 0 else triangles, pose, blocks, hits)
        return hits

    def sensor_poses(self, world_SE3_base: SE3) -> tuple[Floats, Floats, Ints]:
        """Return rotations (S, 3, 3), translations (S, 3) of the sensor in a base frame, and columns' sectors (C,)."""
        sector = np.searchsorted(self._ends, np.arange(self._columns) // LANES, side="right") - 1
        base_SE3_world = world_SE3_base.inverse()
        poses = [base_SE3_world.compose(pose) for pose in self.world_SE3_sensor]
        return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses]), sector
