"""A spinning LiDAR: rays against the real meshes, then noise, drop-out and intensity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.checks import require_count, require_non_negative, require_positive
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.patterns import PATTERNS, BeamPattern
from coopsim.sensors.raycast import RayScene
from coopsim.types import Sweep

MOST_COLUMNS = 16384
"""No sensor fires more often per turn; what is more than this is a slip that would fill the memory."""


@dataclass(frozen=True, slots=True)
class LidarConfig:
    """A LiDAR and where it is.

    The energy of a return follows the LiDAR equation for a surface larger than the beam: proportional to
    reflectivity * cos(incidence) / range^2. A return is lost with probability exp(-energy / `dropout_energy`), where
    energy is 1 for a white surface met head-on at `reference_range_m`.

    Attributes:
        pattern: name of a beam table, or a table of one's own.
        columns: firings per turn.
        min_range_m: nearest return.
        max_range_m: farthest return.
        range_noise_m: standard deviation along the ray.
        reference_range_m: where the energy of a white surface is 1.
        dropout_energy: energy at which 37 % of the returns are lost; 0 loses none.
        above_m: height of the sensor over the agent's body.
    """

    pattern: str | BeamPattern = "HDL-32E"
    columns: int = 1024
    min_range_m: float = 1.0
    max_range_m: float = 120.0
    range_noise_m: float = 0.02
    reference_range_m: float = 50.0
    dropout_energy: float = 0.02
    above_m: float = 0.35

    def __post_init__(self) -> None:
        require_count(1, MOST_COLUMNS, columns=self.columns)
        require_non_negative(
            min_range_m=self.min_range_m,
            range_noise_m=self.range_noise_m,
            dropout_energy=self.dropout_energy,
            above_m=self.above_m,
        )
        require_positive(max_range_m=self.max_range_m, reference_range_m=self.reference_range_m)
        if self.max_range_m <= self.min_range_m:
            raise InvalidValueError(f"max_range_m must be > min_range_m = {self.min_range_m}, got {self.max_range_m!r}")
        if not isinstance(self.pattern, (str, BeamPattern)):
            raise InvalidValueError(f"pattern must be a beam table or the name of one, got {self.pattern!r}")
        self.beams  # noqa: B018  (an unknown name is refused now)

    @property
    def beams(self) -> BeamPattern:
        """The beam table."""
        return self.pattern if isinstance(self.pattern, BeamPattern) else PATTERNS.get(self.pattern)


class Lidar:
    """Makes sweeps; one object serves any number of agents.

    Args:
        config: the sensor.
    """

    def __init__(self, config: LidarConfig) -> None:
        self.config = config
        beams = config.beams
        self._directions = beams.directions(config.columns)
        self._beam = np.repeat(np.arange(len(beams.elevation_rad)), config.columns)

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
        config = self.config
        base_m = np.array([0.0, 0.0, mount_height_m + config.above_m])
        toward = world_SE3_base.rotate(self._directions)
        hits = scene.cast(world_SE3_base.apply(base_m), toward)
        # For all rays, hit or not: what one ray meets must not shift the noise of the next.
        noise, chance = rng.standard_normal(len(hits.face), np.float32), rng.random(len(hits.face), np.float32)
        kept = np.flatnonzero((hits.range_m >= config.min_range_m) & (hits.range_m <= config.max_range_m))
        face, distance = hits.face[kept], hits.range_m[kept]
        directions = self._directions[kept]
        incidence = np.abs(np.einsum("ij,ij->i", scene.normals[face], toward[kept]))
        bounced = scene.triangles.reflectivity[face] * incidence
        energy = bounced * (config.reference_range_m / distance) ** 2
        instance = scene.triangles.instance[face]
        returned = np.ones(len(kept), dtype=np.bool_)
        if config.dropout_energy > 0:
            returned = chance[kept] >= np.exp(-energy / config.dropout_energy)
        if own_id is not None:
            returned &= instance != own_id
        measured = distance[returned] + config.range_noise_m * noise[kept][returned]
        measured = np.clip(measured, config.min_range_m, config.max_range_m)
        points = base_m + directions[returned] * measured[:, None]
        # What sensors report is calibrated for range: what is left is the surface.
        return Sweep(points, bounced[returned], self._beam[kept][returned], instance[returned])
