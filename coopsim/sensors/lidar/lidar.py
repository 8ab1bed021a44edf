"""A spinning LiDAR: its configuration and mounting, and sweeps by rays against meshes, with noise and drop-out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats, rotation_about
from coopsim.sensors import FARTHEST_M, FARTHEST_MOUNT_M, MOST_RAYS
from coopsim.sensors.lidar.imperfections import Imperfections
from coopsim.sensors.lidar.patterns import BeamPattern, find_pattern
from coopsim.sensors.lidar.ray_grid import GridHits, RayGrid, Revolution
from coopsim.sensors.lidar.returns import Echoes, Optics, footprint_patterns, merge_echoes, receive, reflect
from coopsim.sensors.scene import STATIC_ID, RayScene, Singles, Triangles
from coopsim.sensors.weather import Weather, WeatherClutter
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_finite_number,
    require_non_negative,
    require_positive,
)
from coopsim.types import Ints, Sweep
from coopsim.world.models.model import Model

MOST_COLUMNS = 16384
"""Most firings per revolution. No sensor has more; a larger number is a slip that would fill the memory."""

BACKENDS = ("grid", "embree")
_SLACK_M = 0.1  # more than ranges are rounded
_NOBODY = -2  # an instance that no face has


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """A LiDAR and its mounting.

    The energy of a return follows the LiDAR equation for a surface larger than the beam: it is proportional to
    reflectivity * cos(incidence) / range^2. A return is lost with probability exp(-energy / `dropout_energy`), where
    energy is 1 for a white surface met head-on at `reference_range_m`. So dark surfaces, and surfaces met at grazing
    incidence, are seen less far. Default energies, ranges and noise are ours: at 134 m, half of the returns of an
    albedo of 0.1 are left.

    Attributes:
        pattern: name of a beam table, path of a file with one (see `load_pattern`), or a `BeamPattern`.
        columns: firings per revolution; times the beams, at most 8,388,608 rays.
        min_range_m: nearest return (HDL-32E manual: about 1).
        max_range_m: farthest return, at most 10 km (HDL-32E manual: 100).
        range_noise_m: standard deviation along the ray.
        reference_range_m: range at which the energy of a white surface is 1.
        dropout_energy: energy at which 37 % of the returns are lost; 0 loses none.
        above_m: height of the sensor over the agent's body; negative below its top. This and the next two are in
            [-100, 100].
        x_m: distance ahead of the agent's middle.
        y_m: distance to the left of it.
        roll_rad: rotation about the agent's x axis, applied first.
        pitch_rad: rotation about its y axis, applied second: positive looks down.
        yaw_rad: rotation about its z axis, applied last: positive looks to the left.
        divergence_rad: full angle of the beams' cones, 0 for none: mixed pixels at edges, at five times the rays (a
            Velodyne's is 0.003 to the sides, and half of it up and down).
        pulse_m: echoes within one beam that are closer together than this merge: half the way of light in the pulse's
            time, 5 ns by default.
        turn_s: time of a revolution, over which the agent and all others move; 0: all rays at one time. Points are
            where the moving agent would have them at the end of the revolution.
        backend: "grid" draws all rays at once (see `coopsim.sensors.lidar.ray_grid`); "embree" casts them one by
            one, as a reference.
        imperfections: errors of mount, optics and timing, as on the road; None: none.
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
    backend: Literal["grid", "embree"] = "grid"
    imperfections: Imperfections | None = None

    def __post_init__(self) -> None:
        require_count(1, MOST_COLUMNS, columns=self.columns)
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
        if self.imperfections is not None and not isinstance(self.imperfections, Imperfections):
            raise InvalidValueError(f"imperfections must be Imperfections or None, got {self.imperfections!r}")
        if self.imperfections is not None and self.imperfections.edge_rad > 0 and self.divergence_rad > 0:
            raise InvalidValueError("divergence_rad must be 0 with imperfections that have an edge_rad > 0: give one")
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

    def base_SE3_sensor(self, body_height_m: float) -> SE3:
        """Return the sensor's pose on an agent whose body is `body_height_m` high."""
        rotation = (
            rotation_about(2, self.yaw_rad) @ rotation_about(1, self.pitch_rad) @ rotation_about(0, self.roll_rad)
        )
        return SE3(rotation, self.mount_m(body_height_m))

    def mount_m(self, body_height_m: float) -> Floats:
        """Return the sensor's place (3,) in the base frame of an agent whose body is `body_height_m` high."""
        return np.array([self.x_m, self.y_m, body_height_m + self.above_m])


class Lidar:
    """LiDAR that makes sweeps; one object serves any number of agents and, with the backend "grid", of threads."""

    def __init__(self, config: LidarConfig, weather: Weather | None = None) -> None:
        self.config, self._weather = config, weather or Weather()
        beams = config.beams
        self._shape = len(beams.elevation_rad), config.columns
        self._patterns = footprint_patterns(beams, config.divergence_rad)
        # Of several echoes in a beam the strongest counts, though it may come from too far away.
        one_echo = not self._weather.has_clutter and config.divergence_rad == 0
        reach_m = config.max_range_m + _SLACK_M if one_echo else np.inf
        self._grids = [RayGrid(rays.elevation_rad, rays.offset_rad, config.columns, reach_m) for rays in self._patterns]
        told = beams if config.imperfections is None else config.imperfections.told_beams(beams)
        self._directions = told.directions(config.columns).astype(np.float32).reshape(*self._shape, 3)
        self._clutter: WeatherClutter | None = None
        if self._weather.has_clutter:
            self._clutter = WeatherClutter(
                self._weather, config.reference_range_m, config.dropout_energy, config.max_range_m
            )
        self._optics = Optics(
            config.min_range_m,
            config.max_range_m,
            config.range_noise_m,
            config.reference_range_m,
            config.dropout_energy,
            self._weather.extinction_per_m,
            self._weather.range_noise_per_m,
        )

    def sense(
        self,
        scene: RayScene,
        world_SE3_base: SE3,
        body_height_m: float,
        own_id: int | None,
        rng: np.random.Generator,
        start: SE3 | None = None,
    ) -> Sweep:
        """Make one sweep, in the agent's base frame, with instance ids.

        The agent's true poses are those at the end of the revolution and, if it moves, at its `start`, `turn_s` ago.
        Rays that end on the actor `own_id` give no return. Every sweep takes the same number of draws from `rng`.
        """
        told, flaws = self.config.base_SE3_sensor(body_height_m), self.config.imperfections
        true = told if flaws is None else told.compose(flaws.told_SE3_true)
        revolution = Revolution(start or world_SE3_base, world_SE3_base, true, self.config.turn_s, self.config.columns)
        echoes = self._echoes(scene, revolution)
        # For all rays, hit or not: what one ray hits must not shift the noise of the next.
        rays = echoes[0].size
        draws = rng.standard_normal(rays, np.float32), rng.standard_exponential(rays, np.float32)
        none = np.zeros(0, np.float32)
        clutter = (none, none) if self._clutter is None else self._clutter.draw(rays, rng)
        if flaws is not None:
            echoes = flaws.worsen(echoes, scene.triangles, self._patterns[0], self.config.pulse_m, rng)
        points, intensity, beam, instance = receive(
            self._optics,
            Echoes(*echoes, *clutter),
            scene.triangles.instance,
            _NOBODY if own_id is None else own_id,
            draws,
            self._directions,
            revolution.sensor_poses(world_SE3_base, told),
        )
        if flaws is not None:
            intensity = flaws.report(intensity, points - told.translation.astype(np.float32))
            flaws.drag(points, beam, instance, scene.triangles, world_SE3_base, told.translation, own_id)
        return Sweep(points, intensity, beam, instance)

    def _echoes(self, scene: RayScene, revolution: Revolution) -> tuple[Singles, Singles, Ints]:
        """Return each beam's range (m), share of its light that is thrown back, and face; (R,) each."""
        echoes = []
        for pattern, grid in zip(self._patterns, self._grids, strict=True):
            if self.config.backend == "grid":
                hits = revolution.cast(grid, scene.triangles)
            else:
                hits = self._cast_by_embree(scene, revolution.world_SE3_sensor[0], pattern)
            face, cosine = hits.face.reshape(-1), hits.cosine.reshape(-1)
            if self.config.imperfections is not None:
                cosine = self.config.imperfections.fall_off(cosine)
            bounced = reflect(face, cosine, scene.triangles.reflectivity, self._weather.wetness)
            echoes.append((hits.range_m.reshape(-1), bounced, face))
        if len(echoes) == 1:
            return echoes[0]
        range_m, bounced, face = (np.stack(rows) for rows in zip(*echoes, strict=True))
        return merge_echoes(range_m, bounced, face, self.config.pulse_m)

    def _cast_by_embree(self, scene: RayScene, world_SE3_sensor: SE3, pattern: BeamPattern) -> GridHits:
        toward = world_SE3_sensor.rotate(pattern.directions(self.config.columns))
        hits, shape = scene.cast(world_SE3_sensor.translation, toward), self._shape
        cosine = np.abs(np.einsum("ij,ij->i", scene.normals[hits.face], toward)).astype(np.float32)
        return GridHits(hits.range_m.reshape(shape), hits.face.reshape(shape), cosine.reshape(shape))


_ALL_AROUND = RayGrid(np.radians([-75.0, -40.0, -10.0, 10.0, 40.0, 75.0]), np.zeros(6), 16)


def require_free_mount(sensor: str, config: LidarConfig, height_m: float, body: Model | None) -> None:
    """Require a LiDAR above the ground and outside the body that carries it; a mast (None) is as thin as a line.

    Raises:
        InvalidValueError: it is under the ground, or inside the body.
    """
    require_above_ground(f"lidar {sensor!r}", config.above_m, height_m)
    at = config.base_SE3_sensor(height_m).translation
    if body is not None and _is_inside(body, at - [0.0, 0.0, height_m / 2]):
        where, sides = (", ".join(f"{value:g}" for value in values) for values in (at, body.size_m))
        raise InvalidValueError(
            f"lidar {sensor!r} at x, y, z = {where} m is inside the body of a {body.name!r} (length, width and height "
            f"{sides} m)"
        )


def require_above_ground(sensor: str, above_m: float, height_m: float) -> None:
    """Raise `InvalidValueError` unless a sensor `above_m` over a body of this height is above the ground."""
    if height_m + above_m <= 0:
        raise InvalidValueError(
            f"{sensor} is {-height_m - above_m:g} m under the ground: above_m = {above_m:g} counts from the top of a "
            f"body that is {height_m:g} m high"
        )


def _is_inside(body: Model, point_m: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    """Return whether a point in the body's axes sees the body on all sides."""
    count = len(body.faces)
    alone = Triangles(
        body.vertices, body.faces, np.full(count, STATIC_ID), body.reflectivity, np.zeros((count, 3), dtype=np.uint8)
    )
    return bool((_ALL_AROUND.cast(alone, SE3(np.eye(3), point_m)).face >= 0).all())
