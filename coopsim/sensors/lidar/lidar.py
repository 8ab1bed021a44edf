"""A spinning LiDAR: rays against the real meshes, then noise, drop-out and intensity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.lidar.cast.ray_grid import GridHits, RayGrid
from coopsim.sensors.lidar.cast.triangle_setup import Singles
from coopsim.sensors.lidar.footprint import merge, rays_of
from coopsim.sensors.lidar.pattern_files import find_pattern
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.lidar.returns import Echoes, Optics, receive, reflect
from coopsim.sensors.lidar.shutter import SECTORS, Turn
from coopsim.sensors.limits import FARTHEST_M, FARTHEST_MOUNT_M, MOST_RAYS
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.weather import Clutter, Weather
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_finite_number,
    require_non_negative,
    require_positive,
)
from coopsim.types import Ints, Sweep

if TYPE_CHECKING:
    from coopsim.sensors.lidar.cast.torch_grid import TorchGrid

MOST_COLUMNS = 16384
"""No sensor fires more often per turn; what is more than this is a slip that would fill the memory."""

BACKENDS = ("grid", "torch", "embree")
_NOBODY = -2  # an instance that no face has


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """A LiDAR and where it is.

    The energy of a return follows the LiDAR equation for a surface larger than the beam: proportional to
    reflectivity * cos(incidence) / range^2. A return is lost with probability exp(-energy / `dropout_energy`), where
    energy is 1 for a white surface met head-on at `reference_range_m`. So what is dark or met aslant is seen less far.
    Default energies, ranges and noise are ours: half of the returns of an albedo of 0.1 are left at 134 m.

    Attributes:
        pattern: name of a beam table, path of one (see `load_pattern`), or a table of one's own.
        columns: firings per turn; times the beams, at most 8,388,608 rays.
        min_range_m: nearest return (HDL-32E manual: about 1).
        max_range_m: farthest return, at most 10 km (the same: 100).
        range_noise_m: standard deviation along the ray.
        reference_range_m: where the energy of a white surface is 1.
        dropout_energy: energy at which 37 % of the returns are lost; 0 loses none.
        above_m: height of the sensor over the agent's body; negative below its top. This and the next two are in
            [-100, 100].
        x_m: how far ahead of the middle of the agent.
        y_m: how far to its left.
        roll_rad: turn about the agent's x axis, first.
        pitch_rad: turn about its y axis, second: looking down is positive.
        yaw_rad: turn about its z axis, last: looking to the left is positive.
        divergence_rad: full angle of the beams' cones, 0 for none: mixed pixels at edges, at five times the rays (a
            Velodyne's is 0.003 to the sides, and half of it up and down).
        pulse_m: echoes within one beam that are closer together than this merge: half the way of light in the pulse's
            time, 5 ns by default.
        turn_s: time of a turn, over which the agent and all others move; 0: all rays at one time. Points are where the
            moving agent would have them at the end of the turn.
        backend: "grid" draws all rays at once (see `coopsim.sensors.lidar.cast.ray_grid`); "torch" does so on a GPU
        where there is one
            (`coopsim.sensors.lidar.cast.torch_grid`); "embree" casts each, as a reference.
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
    divergence_rad: float = 0.0
    pulse_m: float = 0.75
    turn_s: float = 0.0
    backend: Literal["grid", "torch", "embree"] = "grid"
    threads: int = 1

    def __post_init__(self) -> None:
        require_count(1, MOST_COLUMNS, columns=self.columns)
        require_count(1, threads=self.threads)
        require_non_negative(
            min_range_m=self.min_range_m,
            range_noise_m=self.range_noise_m,
            dropout_energy=self.dropout_energy,
            pulse_m=self.pulse_m,
        )
        require_between(0, 0.1, divergence_rad=self.divergence_rad)
        require_between(0, 1, turn_s=self.turn_s)
        require_between(-FARTHEST_MOUNT_M, FARTHEST_MOUNT_M, above_m=self.above_m, x_m=self.x_m, y_m=self.y_m)
        require_finite_number(roll_rad=self.roll_rad, pitch_rad=self.pitch_rad, yaw_rad=self.yaw_rad)
        require_positive(max_range_m=self.max_range_m, reference_range_m=self.reference_range_m)
        require_between(0, FARTHEST_M, max_range_m=self.max_range_m, reference_range_m=self.reference_range_m)
        require_choice("backend", self.backend, BACKENDS)
        if self.turn_s > 0 and self.backend == "embree":
            raise InvalidValueError("turn_s must be 0 with the backend embree, which casts all rays at one time")
        if self.max_range_m <= self.min_range_m:
            raise InvalidValueError(f"max_range_m must be > min_range_m = {self.min_range_m}, got {self.max_range_m!r}")
        if not isinstance(self.pattern, (str, BeamPattern)):
            raise InvalidValueError(f"pattern must be a beam table or the name of one, got {self.pattern!r}")
        rays = len(self.beams.elevation_rad) * self.columns  # an unknown name is refused here
        if rays > MOST_RAYS:
            raise InvalidValueError(f"columns times beams must be at most {MOST_RAYS}, got {rays}")

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
        weather: around it.
    """

    def __init__(self, config: LidarConfig, weather: Weather | None = None) -> None:
        self.config, self._weather = config, weather or Weather()
        beams = config.beams
        self._shape = len(beams.elevation_rad), config.columns
        self._tables = rays_of(beams, config.divergence_rad)
        make_grid = _torch_grid() if config.backend == "torch" else RayGrid
        self._grids = [make_grid(table, config.columns) for table in self._tables]
        self._directions = beams.directions(config.columns).astype(np.float32).reshape(*self._shape, 3)
        self._clutter: Clutter | None = None
        if self._weather.has_clutter:
            clutter = self._weather, config.reference_range_m, config.dropout_energy, config.max_range_m
            self._clutter = Clutter(*clutter)

    def sense(
        self,
        scene: RayScene,
        world_SE3_base: SE3,
        mount_height_m: float,
        own_id: int | None,
        rng: np.random.Generator,
        start: SE3 | None = None,
    ) -> Sweep:
        """One sweep, in the agent's base frame, with instance ids.

        Args:
            scene: what there is.
            world_SE3_base: the agent's true pose, at the end of the turn.
            mount_height_m: height of the agent's body, on which the sensor stands.
            own_id: the actor that carries the sensor: rays that end on it give no return.
            rng: the agent's stream. Takes the same number of draws for every sweep.
            start: the agent's true pose at the start of the turn, which took `turn_s`; None: it stood still.
        """
        base_SE3_sensor = self.config.base_SE3_sensor(mount_height_m)
        turn = self._turn(world_SE3_base, start, base_SE3_sensor)
        range_m, bounced, face = self._echoes(scene, turn)
        # For all rays, hit or not: what one ray meets must not shift the noise of the next.
        draws = rng.standard_normal(face.size, np.float32), rng.standard_exponential(face.size, np.float32)
        none = np.zeros(0, np.float32)
        clutter = (none, none) if self._clutter is None else self._clutter.draw(face.size, rng)
        points, intensity, beam, instance = receive(
            self._optics,
            Echoes(range_m, bounced, face, *clutter),
            scene.triangles.instance,
            _NOBODY if own_id is None else own_id,
            draws,
            self._directions,
            turn.poses(world_SE3_base),
        )
        return Sweep(points, intensity, beam, instance)

    @property
    def _optics(self) -> Optics:
        config, weather = self.config, self._weather
        return Optics(
            config.min_range_m,
            config.max_range_m,
            config.range_noise_m,
            config.reference_range_m,
            config.dropout_energy,
            weather.extinction_per_m,
            weather.range_noise_per_m,
        )

    def _turn(self, world_SE3_base: SE3, start: SE3 | None, base_SE3_sensor: SE3) -> Turn:
        blocks = self._grids[0].blocks
        sectors = min(SECTORS, blocks) if self.config.turn_s > 0 else 1
        return Turn(
            start or world_SE3_base,
            world_SE3_base,
            base_SE3_sensor,
            self.config.turn_s,
            sectors,
            self._shape[1],
            blocks,
        )

    def _echoes(self, scene: RayScene, turn: Turn) -> tuple[Singles, Singles, Ints]:
        """What each beam meets: range (m), share of its light that is thrown back, and face; (R,) each."""
        echoes = []
        for k in range(len(self._grids)):
            hits = self._cast(scene, turn, k)
            face, cosine = hits.face.reshape(-1), hits.cosine.reshape(-1)
            bounced = reflect(face, cosine, scene.triangles.reflectivity, self._weather.wetness)
            echoes.append((hits.range_m.reshape(-1), bounced, face))
        if len(echoes) == 1:
            return echoes[0]
        range_m, bounced, face = (np.stack(parts) for parts in zip(*echoes, strict=True))
        return merge(range_m, bounced, face, self.config.pulse_m)

    def _cast(self, scene: RayScene, turn: Turn, k: int) -> GridHits:
        """The hits of the `k`-th ray of every beam."""
        if self.config.backend != "embree":
            return turn.cast(self._grids[k], scene.triangles, self.config.threads)
        pose = turn.world_SE3_sensor(0)
        toward = pose.rotate(self._tables[k].directions(self.config.columns))
        hits = scene.cast(pose.translation, toward)
        cosine = np.abs(np.einsum("ij,ij->i", scene.normals[hits.face], toward)).astype(np.float32)
        shape = self._shape
        return GridHits(hits.range_m.reshape(shape), hits.face.reshape(shape), cosine.reshape(shape))


def _torch_grid() -> type[TorchGrid]:
    """Torch is imported by who uses it only: that takes seconds."""
    try:
        from coopsim.sensors.lidar.cast.torch_grid import TorchGrid
    except ImportError as missing:
        raise InvalidValueError("the LiDAR backend torch needs torch: pip install 'coopsim[learn]'") from missing
    return TorchGrid


def _turn(axis: int, angle_rad: float) -> Floats:
    """(3, 3) rotation about x (0), y (1) or z (2)."""
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[a, a] = turn[b, b] = np.cos(angle_rad)
    turn[b, a] = np.sin(angle_rad)
    turn[a, b] = -turn[b, a]
    return turn
