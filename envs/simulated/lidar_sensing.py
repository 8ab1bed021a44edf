"""The agents' LiDARs in each frame: sweeps, or, where no rays are cast, the returns to expect."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.lidar.ray_grid import interpolate
from coopsim.sensors.lidar.returns import count_returns
from coopsim.sensors.scene import RayScene
from coopsim.sensors.weather import Weather
from coopsim.support.rng import stream
from coopsim.support.threads import run_all
from coopsim.types import Ints, Sweep
from coopsim.world.snapshot import Actors, AgentBody, StaticPart

Lidars = Mapping[str, Mapping[str, Lidar]]
"""By kind of agent and name of the sensor."""

Scene = Callable[[], RayScene]


@dataclass(frozen=True, slots=True, eq=False)
class LidarReading:
    """The output of one agent's LiDARs in one frame.

    Attributes:
        returns: (N,) number of returns from each of the N actors.
        sweeps: sweeps by sensor, with instance ids; empty where no rays are cast.
    """

    returns: Ints
    sweeps: Mapping[str, Sweep] = field(default_factory=dict)


class LidarSensing(ABC):
    """The LiDARs of all agents over one episode; asked once in each frame, in order."""

    @abstractmethod
    def sense(self, scene: Scene, actors: Actors, bodies: Mapping[str, AgentBody]) -> dict[str, LidarReading]:
        """Return each agent's reading. The scene is made when first asked for."""

    def skip(self, actors: Actors, bodies: Mapping[str, AgentBody]) -> None:
        """Let a frame pass in which nothing is sensed."""


class CastSweeps(LidarSensing):
    """Sweeps by casting rays, for several agents in parallel."""

    def __init__(self, lidars: Lidars, agents: Iterable[str], seed: int, dt_s: float, threads: int) -> None:
        self._lidars, self._dt_s, self._threads = lidars, dt_s, threads
        self._sensors = tuple(next(iter(lidars.values())))
        self._rngs = {
            (agent, sensor): stream(seed, "lidar", agent, sensor) for agent in agents for sensor in self._sensors
        }
        self._before: dict[str, SE3] = {}

    def sense(self, scene: Scene, actors: Actors, bodies: Mapping[str, AgentBody]) -> dict[str, LidarReading]:
        """Cast all LiDARs' rays; see `LidarSensing.sense`."""
        triangles = scene()
        before = self._before or {name: self._back(actors, body) for name, body in bodies.items()}

        def sense_one(body: AgentBody) -> LidarReading:
            sweeps = {sensor: self._sweep(triangles, body, sensor, before[body.name]) for sensor in self._sensors}
            return LidarReading(count_returns(sweeps, actors.id), sweeps)

        readings = run_all([partial(sense_one, body) for body in bodies.values()], self._threads)
        self.skip(actors, bodies)
        return dict(zip(bodies, readings, strict=True))

    def skip(self, actors: Actors, bodies: Mapping[str, AgentBody]) -> None:
        """Note where agents are, from where they move during the next revolution."""
        self._before = {name: body.world_SE3_base for name, body in bodies.items()}

    def _sweep(self, scene: RayScene, body: AgentBody, sensor: str, before: SE3) -> Sweep:
        """Cast a sweep that ends now, of an agent that was at `before` a frame ago."""
        lidar, now, rng = self._lidars[body.kind][sensor], body.world_SE3_base, self._rngs[body.name, sensor]
        start = interpolate(before, now, 1.0 - lidar.config.turn_s / self._dt_s)
        return lidar.sense(scene, now, body.height_m, body.actor_id, rng, start)

    def _back(self, actors: Actors, body: AgentBody) -> SE3:
        """Return an agent's pose a frame before the first: straight behind, at its speed."""
        if body.actor_id is None:
            return body.world_SE3_base
        (velocity,) = actors.velocity[actors.id == body.actor_id]
        moved = np.append(velocity, 0.0) * self._dt_s
        return SE3(body.world_SE3_base.rotation, body.world_SE3_base.translation - moved)


class ExpectReturns(LidarSensing):
    """The returns to expect of LiDARs, by lines of sight (see `coopsim.sensors.lidar.expected_returns`).

    Args:
        config: the LiDAR that every agent would carry.
        drone_pitch_rad: angle by which a drone's LiDAR looks down, on all sides.
        static: the scenery.
        weather: dims the returns; None is dry and clear.
    """

    def __init__(
        self, config: LidarConfig, drone_pitch_rad: float, static: Sequence[StaticPart], weather: Weather | None
    ) -> None:
        self._config = config
        down = BeamPattern("looking down", config.beams.elevation_rad - drone_pitch_rad)
        level = ReturnsEstimator(static, config.beams, config.columns, config.max_range_m, weather)
        self._sights = [(level, ("cav", "rsu")), (level.with_beams(down), ("drone",))]

    def sense(self, scene: Scene, actors: Actors, bodies: Mapping[str, AgentBody]) -> dict[str, LidarReading]:
        """Estimate the returns by lines of sight; see `LidarSensing.sense`."""
        readings: dict[str, LidarReading] = {}
        for sight, kinds in self._sights:
            carriers = [body for body in bodies.values() if body.kind in kinds]
            if carriers:
                own_ids = [body.actor_id for body in carriers]
                returns = sight.expected_returns(self._origins_m(carriers), actors, own_ids)
                readings |= {body.name: LidarReading(each) for body, each in zip(carriers, returns, strict=True)}
        return {name: readings[name] for name in bodies}

    def _origins_m(self, bodies: Sequence[AgentBody]) -> Floats:
        """Return the places (A, 3) of the agents' LiDARs in the world frame."""
        turn = np.array([body.world_SE3_base.rotation for body in bodies])
        shift = np.array([body.world_SE3_base.translation for body in bodies])
        mounts_m = np.array([self._config.mount_m(body.height_m) for body in bodies])
        origins_m: Floats = np.einsum("aij,aj->ai", turn, mounts_m) + shift
        return origins_m


class CastSomeSweeps(LidarSensing):
    """Sweeps of the agents that carry LiDARs, and the returns to expect of one on each of the others."""

    def __init__(self, cast: LidarSensing, carriers: Collection[str], expected: LidarSensing) -> None:
        self._cast, self._carriers, self._expected = cast, carriers, expected

    def sense(self, scene: Scene, actors: Actors, bodies: Mapping[str, AgentBody]) -> dict[str, LidarReading]:
        """Cast rays, or estimate the returns; see `LidarSensing.sense`."""
        others = {name: body for name, body in bodies.items() if name not in self._carriers}
        readings = self._cast.sense(scene, actors, self._carrying(bodies))
        readings |= self._expected.sense(scene, actors, others)
        return {name: readings[name] for name in bodies}

    def skip(self, actors: Actors, bodies: Mapping[str, AgentBody]) -> None:
        """Let a frame pass; see `LidarSensing.skip`."""
        self._cast.skip(actors, self._carrying(bodies))

    def _carrying(self, bodies: Mapping[str, AgentBody]) -> dict[str, AgentBody]:
        return {name: body for name, body in bodies.items() if name in self._carriers}
