"""One episode of a simulated environment: traffic, then sensors, then perception, one frame at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from coopsim.envs.frames import AgentFrame, Frame, FrameProbe
from coopsim.envs.simulated.equipment import Equipment
from coopsim.envs.simulated.lidar_sensing import (
    CastSomeSweeps,
    CastSweeps,
    ExpectReturns,
    LidarReading,
    LidarSensing,
)
from coopsim.envs.simulated.perception import Perception
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.envs.simulated.surroundings import Surroundings
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import SceneGeometry
from coopsim.sensors.visibility.lidar_visibility import Visibility
from coopsim.sensors.visibility.pixel_visibility import PixelVisibility, measure_pixels
from coopsim.support.arrays import look_up
from coopsim.types import AgentSpec, CameraImage, Ints, Sweep, seconds_to_ns
from coopsim.world.snapshot import Actors, AgentBody, WorldSource


class SimulatedEpisode:
    """A running episode.

    Args:
        options: how the world is sensed and scored.
        equipment: the agents' sensors.
        world: the world, at its first frame.
        specs: the agents.
        seed: the episode's seed.
    """

    def __init__(
        self,
        options: SimulationOptions,
        equipment: Equipment,
        world: WorldSource,
        specs: Mapping[str, AgentSpec],
        seed: int,
    ) -> None:
        self._options, self._equipment, self._world, self._specs = options, equipment, world, specs
        self._geometry = SceneGeometry(world.models, world.static)
        self._lidars = self._lidar_sensing(specs, seed)
        self._perception = Perception(options, specs, seed)
        self._cycle = 0
        self._last_sensed: tuple[Ints, Ints]  # ids (N,) of all actors, returns (N, A) from each to each agent

    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        """Step the world and return the next frame; `maneuvers` are those of the agents that drive."""
        self._world.step(self._options.dt_s, maneuvers)
        self._cycle += 1
        return self.frame()

    def frame(self) -> Frame:
        """Sense the world as it is now."""
        # From the cycle, not by addition: 0.1 s must not drift from the tenth of a second.
        time_ns = seconds_to_ns(self._cycle * self._options.dt_s)
        actors, bodies = self._world.actors(), self._world.agents()
        sensed = self._cycle % self._options.sense_every == 0
        scene = cache(lambda: RayScene(self._geometry.triangles(actors)))
        readings = self._lidars.sense(scene, actors, bodies) if sensed else {}
        probe = SceneProbe(self._equipment, scene, actors, bodies, readings)
        if sensed:
            self._last_sensed = actors.id, np.stack([reading.returns for reading in readings.values()], axis=1)
            sweeps = {name: reading.sweeps for name, reading in readings.items()}
            images = probe.photograph() if self._equipment.has_cameras else {}
        else:
            self._lidars.skip(actors, bodies)
            sweeps = {name: dict.fromkeys(self._specs[name].lidars, Sweep.empty()) for name in bodies}
            images = {name: self._equipment.blank_images(name) for name in bodies}
        around = Surroundings.of(bodies, actors, self._returns(actors))
        observations = self._perception.observe(time_ns, around.oracles, sweeps, images, sensed=sensed)
        truths = around.truths(self._options.region_m, all_count=self._options.ground_truth == "all")
        agents = {
            name: AgentFrame(
                observations[name],
                bodies[name],
                truth,
                {sensor: sweep.instance for sensor, sweep in sweeps[name].items() if sweep.instance is not None},
                images.get(name, {}),
            )
            for name, truth in truths.items()
        }
        return Frame(time_ns, agents, actors, self._cycle >= self._options.max_cycles, probe)

    def _lidar_sensing(self, specs: Mapping[str, AgentSpec], seed: int) -> LidarSensing:
        options, carriers = self._options, self._equipment.lidar_carriers
        if not carriers:
            usual = LidarConfig(columns=options.lidar_columns, max_range_m=options.lidar_range_m)
            return self._expected_returns(usual)
        agents = [name for name in specs if name in carriers]
        cast = CastSweeps(self._equipment.lidars, agents, seed, options.dt_s, options.sweep_threads)
        if len(agents) == len(specs):
            return cast
        first = next(iter(options.lidars.values()))
        return CastSomeSweeps(cast, carriers, self._expected_returns(first))

    def _expected_returns(self, config: LidarConfig) -> ExpectReturns:
        options = self._options
        return ExpectReturns(config, options.drone_pitch_rad, self._world.static, options.chosen_weather)

    def _returns(self, actors: Actors) -> Ints:
        """Return the number of returns (N, A) from each actor when last sensed; 0 for those that came since."""
        ids, sensed = self._last_sensed
        if ids is actors.id:
            return sensed
        order = np.argsort(ids)
        place, known = look_up(ids[order], actors.id)
        returns = np.zeros((len(actors), sensed.shape[1]), np.int64)
        returns[known] = sensed[order[place[known]]]
        return returns


class SceneProbe(FrameProbe):
    """Measurements of one simulated frame.

    Args:
        equipment: the agents' sensors.
        scene: makes the frame's triangles when first asked for.
        actors: in the frame.
        bodies: of the agents, by name.
        readings: of the agents' LiDARs; empty in a frame in which nothing is sensed.
    """

    def __init__(
        self,
        equipment: Equipment,
        scene: Callable[[], RayScene],
        actors: Actors,
        bodies: Mapping[str, AgentBody],
        readings: Mapping[str, LidarReading],
    ) -> None:
        self._equipment, self._scene, self._actors, self._bodies = equipment, scene, actors, bodies
        self._readings = readings

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """Return images by every agent's cameras; see `FrameProbe.photograph`."""
        return self._equipment.rig.render(self._scene().triangles, self._actors, self._bodies)

    def visibility(self) -> Mapping[str, Visibility]:
        """Follow the LiDARs' rays through everything; see `FrameProbe.visibility`."""
        probes = self._equipment.visibility_probes
        return {
            name: probes[self._bodies[name].kind].measure(
                self._scene(), self._bodies[name], self._actors, reading.returns
            )
            for name, reading in self._readings.items()
            if reading.sweeps
        }

    def pixel_visibility(self) -> Mapping[str, PixelVisibility]:
        """Follow the cameras' rays through everything; see `FrameProbe.pixel_visibility`."""
        if not self._readings or not self._equipment.images_tell_actors:
            return {}
        return {
            name: measure_pixels(cameras, self._scene(), self._bodies[name], self._actors)
            for name, cameras in self._equipment.cameras.items()
            if cameras
        }
