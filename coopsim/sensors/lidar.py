"""A spinning LiDAR: rays against the real meshes, then noise, drop-out and intensity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from coopsim.checks import (
    require_choice,
    require_count,
    require_finite_number,
    require_non_negative,
    require_positive,
)
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.grid import GridHits, RayGrid
from coopsim.sensors.pattern_files import find_pattern
from coopsim.sensors.patterns import BeamPattern
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.returns import Echoes, Optics, receive, reflect
from coopsim.types import Sweep

MOST_COLUMNS = 16384
"""No sensor fires more often per turn; what is more than this is a slip that would fill the memory."""

BACKENDS = ("grid", "embree")
_NOBODY = -2  # an instance that no face has


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """A LiDAR and where it is.

    The energy of a return follows the LiDAR equation for a surface larger than the beam: proportional to
    reflectivity * cos(incidence) / range^2. A return is lost with probability exp(-energy / `dropout_energy`), where
    energy is 1 for a white surface met head-on at `reference_range_m`. So what is dark or met aslant is seen less far.

    Attributes:
        pattern: name of a beam table, path of one (see `load_pattern`), or a table of one's own.
        columns: firings per turn.
        min_range_m: nearest return.
        max_range_m: farthest return.
        range_noise_m: standard deviation along the ray.
        reference_range_m: where the energy of a white surface is 1.
        dropout_energy: energy at which 37 % of the returns are lost; 0 loses none.
        above_m: height of the sensor over the agent's body; negative below its top.
        x_m: how far ahead of the middle of the agent.
        y_m: how far to its left.
        roll_rad: turn about the agent's x axis, first.
        pitch_rad: turn about its y axis, second: looking down is positive.
        yaw_rad: turn about its z axis, last: looking to the left is positive.
        backend: "grid" draws all rays at once (see `coopsim.sensors.grid`); "embree" casts each, as a reference.
        threads: that share a sweep, with "grid"; they change nothing but the time.
    """

    pattern: str | BeamPattern = "HDL-32E"
    columns: int = 1024
    min_range_m: float = 1.0
    max_range_m: float = 120.0
    range_noise_m: float = 0.02
    reference_range_m: float = 50.0
    dropout_energy: float = 0.02
    above_m: float = 0.35
    x_m: float = 0.0
    y_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    backend: Literal["grid", "embree"] = "grid"
    threads: int = 1

    def __post_init__(self) -> None:
        require_count(1, MOST_COLUMNS, columns=self.columns)
        require_count(1, threads=self.threads)
        require_non_negative(
            min_range_m=self.min_range_m, range_noise_m=self.range_noise_m, dropout_energy=self.dropout_energy
        )
        require_finite_number(above_m=self.above_m, x_m=self.x_m, y_m=self.y_m)
        require_finite_number(roll_rad=self.roll_rad, pitch_rad=self.pitch_rad, yaw_rad=self.yaw_rad)
        require_positive(max_range_m=self.max_range_m, reference_range_m=self.reference_range_m)
        require_choice("backend", self.backend, BACKENDS)
        if self.max_range_m <= self.min_range_m:
            raise InvalidValueError(f"max_range_m must be > min_range_m = {self.min_range_m}, got {self.max_range_m!r}")
        if not isinstance(self.pattern, (str, BeamPattern)):
            raise InvalidValueError(f"pattern must be a beam table or the name of one, got {self.pattern!r}")
        self.beams  # noqa: B018  (an unknown name is refused now)

    @property
    def beams(self) -> BeamPattern:
        """The beam table."""
        return self.pattern if isinstance(self.pattern, BeamPattern) else find_pattern(self.pattern)

    def base_SE3_sensor(self, mount_height_m: float) -> SE3:
        """Where the sensor is on an agent whose body is that high."""
        at = np.array([self.x_m, self.y_m, mount_height_m + self.above_m])
        return SE3(_turn(2, self.yaw_rad) @ _turn(1, self.pitch_rad) @ _turn(0, self.roll_rad), at)


class Lidar:
    """Makes sweeps; one object serves any number of agents.

    Args:
        config: the sensor.
    """

    def __init__(self, config: LidarConfig) -> None:
        self.config = config
        beams = config.beams
        self._grid = RayGrid(beams, config.columns)
        self._directions = beams.directions(config.columns)
        self._shape = len(beams.elevation_rad), config.columns
        self._singles = self._directions.astype(np.float32).reshape(*self._shape, 3)

    def sense(
        self,
        scene: RayScene,
        world_SE3_base: SE3,
        mount_height_m: float,
        own_id: int | None,
        rng: np.random.Generator,
    ) -> Sweep:
        """One sweep, in the agent's base frame, with instance ids.

        Args:
            scene: what there is.
            world_SE3_base: the agent's true pose.
            mount_height_m: height of the agent's body, on which the sensor stands.
            own_id: the actor that carries the sensor: rays that end on it give no return.
            rng: the agent's stream. Takes the same number of draws for every sweep.
        """
        base_SE3_sensor = self.config.base_SE3_sensor(mount_height_m)
        hits = self._cast(scene, world_SE3_base.compose(base_SE3_sensor))
        rays = hits.face.size
        # For all rays, hit or not: what one ray meets must not shift the noise of the next.
        draws = rng.standard_normal(rays, np.float32), rng.standard_exponential(rays, np.float32)
        face = hits.face.reshape(-1)
        bounced = reflect(face, hits.cosine.reshape(-1), scene.triangles.reflectivity, 1.0)
        none = np.zeros(0, np.float32)
        points, intensity, ray, instance = receive(
            self._optics,
            Echoes(hits.range_m.reshape(-1), bounced, face, none, none),
            scene.triangles.instance,
            _NOBODY if own_id is None else own_id,
            draws,
            self._singles,
            (base_SE3_sensor.rotation[None], base_SE3_sensor.translation[None]),
        )
        return Sweep(points, intensity, ray // self.config.columns, instance)

    @property
    def _optics(self) -> Optics:
        config = self.config
        return Optics(
            config.min_range_m,
            config.max_range_m,
            config.range_noise_m,
            config.reference_range_m,
            config.dropout_energy,
            0.0,
            0.0,
        )

    def _cast(self, scene: RayScene, world_SE3_sensor: SE3) -> GridHits:
        if self.config.backend == "grid":
            return self._grid.cast(scene.triangles, world_SE3_sensor, self.config.threads)
        toward = world_SE3_sensor.rotate(self._directions)
        hits = scene.cast(world_SE3_sensor.translation, toward)
        cosine = np.abs(np.einsum("ij,ij->i", scene.normals[hits.face], toward)).astype(np.float32)
        shape = self._shape
        return GridHits(hits.range_m.reshape(shape), hits.face.reshape(shape), cosine.reshape(shape))


def _turn(axis: int, angle_rad: float) -> Floats:
    """(3, 3) rotation about x (0), y (1) or z (2)."""
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a] = turn[b, b] = np.cos(angle_rad)
    turn[b, a] = np.sin(angle_rad)
    turn[a, b] = -turn[b, a]
    return turn
