"""Ray casting of a spinning LiDAR: every triangle is drawn into the grid of the sensor's rays, as into an image.

The grid is the sensor's own, so any mounting costs the same, and nothing has to be built when things move. A revolution
takes time, so it is cast in sectors, each of which sees the scene of its own moment. Embree (`RayScene.cast`) casts
arbitrary rays one by one; here they must be those of a beam table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.sensors.lidar.raster_kernel import LANES, Beams, Canvas, draw, resolve
from coopsim.sensors.lidar.triangle_setup import Corners, Scene, Shapes, set_up
from coopsim.sensors.scene import Parts, Singles, Triangles
from coopsim.support.arrays import sealed
from coopsim.support.kernels import njit
from coopsim.types import Ints

_SECTOR_SLACK_RAD = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class GridHits:
    """Hits of the rays of B beams and C columns, in the order of the beam table.

    Attributes:
        range_m: (B, C) inf where nothing was hit.
        face: (B, C) index of the face, -1 where nothing was hit.
        cosine: (B, C) cosine of the angle between ray and surface normal, in [0, 1]; 0 where nothing was hit.
    """

    range_m: Singles
    face: Ints
    cosine: Singles


class RayGrid:
    """Grid of the rays of a beam table, cast all at one time or by sectors.

    Closed parts (see `Parts`) are hit from outside only. Of open parts, and where the sensor is in the box around a
    closed one, both sides of a triangle are hit. Of two triangles that are equally near, the first is hit. Beams (B,)
    may be in any order; `azimuth_rad` (B,) is each beam's angle to the left of its column. Parts beyond `reach_m` may
    be left out.
    """

    def __init__(self, elevation_rad: Floats, azimuth_rad: Floats, columns: int, reach_m: float = math.inf) -> None:
        self._shape, self._reach_m = (len(elevation_rad), columns), reach_m
        order = np.argsort(-elevation_rad, kind="stable")
        tangent, shift_rad = np.tan(elevation_rad[order]), azimuth_rad[order]
        azimuth = np.arange(self.blocks * LANES) * (2 * np.pi / columns)
        cos, sin = np.cos(azimuth), np.sin(azimuth)
        self._beams = Beams(
            tangent.astype(np.float32),
            shift_rad.astype(np.float32),
            cos.astype(np.float32),
            sin.astype(np.float32),
            columns,
            order,
            (tangent, np.cos(shift_rad), np.sin(shift_rad), cos, sin),
        )

    @property
    def blocks(self) -> int:
        """Number of blocks of `LANES` columns, of which sectors are made; the last may be shorter."""
        return -(-self._shape[1] // LANES)

    def empty_hits(self) -> GridHits:
        """Return uninitialized hits of all rays, to be filled sector by sector."""
        single, face = (np.empty(self._shape, np.float32) for _ in range(2)), np.empty(self._shape, np.int64)
        return GridHits(next(single), face, next(single))

    def cast(self, triangles: Triangles, world_SE3_sensor: SE3) -> GridHits:
        """Cast all rays at one time, from a sensor's pose with any roll and pitch."""
        hits = self.empty_hits()
        self.cast_sector(triangles, world_SE3_sensor, (0, self.blocks), hits)
        return hits

    def cast_sector(self, triangles: Triangles, world_SE3_sensor: SE3, blocks: tuple[int, int], hits: GridHits) -> None:
        """Cast the rays of the blocks of columns from the first to before the last of `blocks`, into `hits`."""
        rotation = np.ascontiguousarray(world_SE3_sensor.rotation)
        parts = triangles.parts or _one_part(triangles)
        # Of scenes some are read-only: the kernels are compiled for those alone.
        vertices, faces = sealed(triangles.vertices.view()), sealed(triangles.faces.view())
        scene = Scene(vertices, faces, parts, rotation, world_SE3_sensor.translation)
        _sweep(scene, self._beams, blocks, self._reach_m, (hits.range_m, hits.face, hits.cosine))


def _one_part(triangles: Triangles) -> Parts:
    return Parts(np.array([0, len(triangles.faces)]), np.array([0, len(triangles.vertices)]), np.zeros(1, np.bool_))


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep(
    scene: Scene, beams: Beams, blocks: tuple[int, int], reach_m: float, hits: tuple[Singles, Ints, Singles]
) -> None:
    """Set the scene up for the sensor, draw it, and write the hits (B, C) of the blocks' columns."""
    vertices, faces, parts = len(scene.vertices), len(scene.faces), len(scene.parts.closed)
    corners = Corners(np.empty((vertices, 3)), np.empty(vertices, np.float32), np.empty(vertices, np.float32))
    shapes = Shapes(
        np.empty(parts, np.int64),
        np.empty((faces, 9), np.float32),
        np.empty((faces, 3)),
        np.empty(faces, np.float32),
        np.empty((faces, 2), np.float32),
        np.empty((faces, 2), np.int32),
        np.empty(faces, np.int64),
    )
    rays = len(beams.tangent), (blocks[1] - blocks[0]) * LANES
    canvas = Canvas(np.empty(rays, np.float32), np.empty(rays, np.int32))
    set_up(scene, beams.tangent, _sector(beams, blocks), reach_m, corners, shapes)
    draw(scene.parts.face_start, shapes, beams, blocks, canvas)
    resolve(shapes, beams, blocks, canvas.owner, hits)


@njit(cache=True, nogil=True, error_model="numpy")
def _sector(beams: Beams, blocks: tuple[int, int]) -> tuple[float, float]:
    """Return the middle and half width (rad) of the azimuths of the rays in some blocks of columns."""
    step_rad = 2 * math.pi / beams.columns
    start = blocks[0] * LANES * step_rad + float(beams.shift_rad.min())
    end = blocks[1] * LANES * step_rad + float(beams.shift_rad.max())
    return (start + end) / 2, (end - start) / 2 + _SECTOR_SLACK_RAD


SECTORS = 32
"""Steps that a revolution is taken in: at 20 m/s and 10 revolutions a second, nothing is off by more than 3 cm."""


def interpolate(start: SE3, end: SE3, fraction: float) -> SE3:
    """Return the gravity-aligned pose at a fraction of the way between two poses; extrapolate below 0 and above 1."""
    turned = float(wrap_angle(end.yaw - start.yaw))
    return SE3.from_xyz_yaw(
        start.translation + fraction * (end.translation - start.translation), start.yaw + fraction * turned
    )


def earlier(triangles: Triangles, seconds: float) -> Triangles:
    """Return the scene as it was some seconds ago, taking all velocities as constant; raise without velocities."""
    if triangles.parts is None or triangles.velocity is None:
        raise InvalidValueError("a scene whose parts have no velocity has no earlier time; make it with SceneGeometry")
    moved = np.repeat(triangles.velocity, np.diff(triangles.parts.vertex_start), axis=0)
    vertices = triangles.vertices.copy()
    vertices[:, :2] -= seconds * moved
    return replace(triangles, vertices=vertices)


class Revolution:
    """Revolution of a LiDAR in S sectors, each of which sees the scene at the middle of the sector's time.

    The agent moves from the pose `start` to `end`. With a `duration_s` of 0 all rays are cast at its end.
    """

    def __init__(self, start: SE3, end: SE3, base_SE3_sensor: SE3, duration_s: float, columns: int) -> None:
        blocks = -(-columns // LANES)
        sectors = min(SECTORS, blocks) if duration_s > 0 else 1
        self._ends: list[int] = np.linspace(0, blocks, sectors + 1).astype(int).tolist()
        self._columns, self._mount = columns, base_SE3_sensor
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

    def sensor_poses(self, world_SE3_base: SE3, told: SE3 | None = None) -> tuple[Floats, Floats, Ints]:
        """Return rotations (S, 3, 3), translations (S, 3) of the sensor in a base frame, and columns' sectors (C,).

        They are as if the sensor were mounted at `told`, if this is given, in place of `base_SE3_sensor`.
        """
        sector = np.searchsorted(self._ends, np.arange(self._columns) // LANES, side="right") - 1
        base_SE3_world = world_SE3_base.inverse()
        if told is not None and told is not self._mount:
            base_SE3_world = told.compose(self._mount.inverse()).compose(base_SE3_world)
        poses = [base_SE3_world.compose(pose) for pose in self.world_SE3_sensor]
        return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses]), sector
