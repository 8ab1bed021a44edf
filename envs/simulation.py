"""The simulated source: traffic, then sensors, localization and detection, one frame at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.envs.frames import AgentFrame, Frame, FrameSource
from coopsim.envs.lidar_sensing import CastSweeps, ExpectReturns, LidarSensing, Sensed
from coopsim.envs.options import SimulationOptions
from coopsim.localization.localizer import Localizer
from coopsim.sensors.camera.camera_rig import CameraRig
from coopsim.sensors.camera.renderers.choice import make_renderer
from coopsim.sensors.camera.rigs import agent_rigs
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.mounting import require_above_ground, require_free_mount
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.scene import SceneGeometry
from coopsim.sensors.visibility.lidar_visibility import Visibility, VisibilityProbe
from coopsim.sensors.visibility.pixel_visibility import PixelVisibility, measure_pixels
from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, CameraImage, GroundTruth, Ints, LidarMounting, Observation, Sweep, seconds_to_ns
from coopsim.world.models.model import Model
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import PlayedWorld, RecordedWorld
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody
from coopsim.world.source import WorldSource
from coopsim.world.world import World


class Simulation(FrameSource):
    """Frames of a `World`, as its agents' sensors see it.

    Args:
        name: the environment's id.
        scenario: what is there.
        options: how it is sensed and scored.
        uplink: what the agents' specs say they broadcast.
        codec: by which codec they say so.
        episode: a recorded world, to be sensed in place of one that happens now.
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        options: SimulationOptions,
        uplink: str,
        codec: str | None = None,
        episode: Episode | None = None,
    ) -> None:
        self.name = name
        self._scenario, self._options, self._episode = scenario, options, episode
        on_ground, in_air = (
            {sensor: Lidar(config, options.chosen_weather) for sensor, config in configs.items()}
            for configs in (options.lidars, options.drone_lidars)
        )
        self._lidars = {"cav": on_ground, "rsu": on_ground, "drone": in_air}
        self._probes = {
            kind: VisibilityProbe([lidar.config for lidar in lidars.values()]) for kind, lidars in self._lidars.items()
        }
        # Embree's scene is made by the first who casts into it, which two could be at once.
        by_embree = any(lidar.config.backend == "embree" for lidar in on_ground.values())
        self._threads = 1 if by_embree else options.threads
        self._detector = options.chosen_detector or SimulatedDetector()
        self.embedding_dim = self._detector.embedding_dim
        self.detection_covariances = self._detector.states_covariance
        self._rig: CameraRig | None = None
        self.camera_modes = tuple(options.camera_modes)
        self.region_m = (options.region_x_m, options.region_y_m)
        self._world = self._make_world(seed=0)
        bodies = self._world.agents()
        kinds = {name: body.kind for name, body in bodies.items()}
        self._cameras = agent_rigs(options.cameras, kinds)
        # Who photographs where no cameras are on gets the pictures that `cameras=True` would make.
        self._photographers = self._cameras if any(self._cameras.values()) else agent_rigs(True, kinds)
        self._uplink, self._codec = uplink, codec
        self.specs = self._specify(bodies)
        self.road_map = self._world.map
        self.capacity = len(self._world.actors()) if episode is None else episode.most_actors
        self.lidars = tuple(options.lidars)
        self._require_free_mounts()
        self.covariances = any(options.localization_of(name).covariance_scale is not None for name in self.specs)
        if isinstance(options.localization, Mapping):
            for agent in options.localization:
                require_choice("agent in localization", agent, self.specs)

    def _make_world(self, seed: int) -> WorldSource:
        if self._episode is not None:
            return PlayedWorld(self._episode, self._scenario)
        policy_control = self._options.control == "policy"
        return World(self._scenario, seed, policy_control=policy_control, traffic=self._options.traffic)

    def _make_sensing(self, world: WorldSource, seed: int) -> LidarSensing:
        options = self._options
        if self.lidars:
            return CastSweeps(self._lidars, self._geometry, self.specs, seed, options.dt_s, self._threads)
        expected = LidarConfig(columns=options.lidar_columns, max_range_m=options.lidar_range_m)
        return ExpectReturns(expected, options.drone_pitch_rad, world.static, options.chosen_weather)

    def _specify(self, bodies: Mapping[str, AgentBody]) -> dict[str, AgentSpec]:
        return {
            name: AgentSpec(
                name,
                body.kind,
                self._options.dt_s,
                self._uplink,
                self._drives(body),
                body.actor_id is not None,
                cameras={camera.name: camera.calibration(body.height_m) for camera in self._cameras[name]},
                codec=self._codec,
                lidars={
                    sensor: _mounting(lidar.config, body.height_m) for sensor, lidar in self._lidars[body.kind].items()
                },
            )
            for name, body in bodies.items()
        }

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        world = self._make_world(seed)
        if self._options.record is not None:
            world = RecordedWorld(world, self._options.record, self._scenario, seed, self._options.dt_s)
        self._time_ns, self._cycle, self._world = 0, 0, world
        self.specs = self._specify(world.agents())
        self._geometry = SceneGeometry(world.models, world.static)
        self._sensing = self._make_sensing(world, seed)
        self._localizers = {
            name: Localizer(self._options.localization_of(name), seed, name, spec.dt_s, stands=spec.kind == "rsu")
            for name, spec in self.specs.items()
        }
        self._detectors = {name: self._detector.begin(seed, name, self._options.dt_s) for name in self.specs}
        self._detector_rngs = {name: stream(seed, "detector", name) for name in self.specs}
        return self._sense()

    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        self._world.step(self._options.dt_s, maneuvers)
        self._cycle += 1
        # From the cycle, not by addition: 0.1 s must not drift from the tenth of a second.
        self._time_ns = seconds_to_ns(self._cycle * self._options.dt_s)
        return self._sense()

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """The current frame through every agent's cameras."""
        if self._rig is None:
            self._rig = CameraRig(
                self._photographers,
                make_renderer(self._options.renderer),
                modes=self.camera_modes,
                illumination=self._options.illumination,
            )
        actors = self._world.actors()
        return self._rig.render(self._geometry.triangles(actors), actors, self._world.agents())

    def visibility(self) -> Mapping[str, Visibility]:
        scene = self._sensing.scene
        if scene is None:
            return {}
        actors, bodies, sensed = self._current
        return {
            name: self._probes[body.kind].measure(scene, body, actors, sensed[name].returns)
            for name, body in bodies.items()
        }

    def pixel_visibility(self) -> Mapping[str, PixelVisibility]:
        if "instance" not in self.camera_modes:
            return {}
        actors, bodies, _ = self._current
        scene = self._sensing.scene or RayScene(self._geometry.triangles(actors))
        return {
            name: measure_pixels(cameras, scene, bodies[name], actors)
            for name, cameras in self._cameras.items()
            if cameras
        }

    def close(self) -> None:
        if self._rig is not None:
            self._rig.close()
            self._rig = None

    def _sense(self) -> Frame:
        actors, bodies = self._world.actors(), self._world.agents()
        sensed = self._sensing.sense(actors, bodies)
        self._current = (actors, bodies, sensed)
        seen = actors.id[np.any([each.returns > 0 for each in sensed.values()], axis=0)]
        images = self.photograph() if any(self._cameras.values()) else {}
        agents = {
            name: self._perceive(body, actors, seen, sensed[name], images.get(name, {}))
            for name, body in bodies.items()
        }
        return Frame(self._time_ns, agents, actors, last=self._cycle >= self._options.max_cycles)

    def _perceive(
        self,
        body: AgentBody,
        actors: Actors,
        seen: Ints,
        sensed: Sensed,
        images: Mapping[str, CameraImage],
    ) -> AgentFrame:
        sweeps, returns = sensed.sweeps, sensed.returns
        other = np.ones(len(actors), np.bool_) if body.actor_id is None else actors.id != body.actor_id
        around = actors[other].transform(body.world_SE3_base.inverse())
        pose, odometry = self._localizers[body.name].localize(body.world_SE3_base)
        detector, rng = self._detectors[body.name], self._detector_rngs[body.name]
        detector.move(body.world_SE3_base)
        if sweeps:
            detections = detector.detect(sweeps, around, rng)
        else:
            detections = detector.detect_from_returns(returns[other], around, rng)
        blind = {sensor: Sweep(sweep.points, sweep.intensity, sweep.beam) for sensor, sweep in sweeps.items()}
        observed = {name: replace(image, instance=None, semantic=None) for name, image in images.items()}
        observation = Observation(self._time_ns, pose, odometry, detections, blind, observed)
        seen_by = np.where(returns[other] > 0, 0, np.where(np.isin(around.id, seen), 1, 2))
        counts = (seen_by < 2) | (self._options.ground_truth == "all")
        counts &= (np.abs(around.boxes.center[:, :2]) <= self.region_m).all(axis=1)
        truth = GroundTruth(around.id[counts], around.boxes[counts], around.label[counts], seen_by[counts])
        instances = {sensor: sweep.instance for sensor, sweep in sweeps.items() if sweep.instance is not None}
        return AgentFrame(observation, body, truth, around.boxes[~counts], around.label[~counts], instances, images)

    def _require_free_mounts(self) -> None:
        """On every body that may come to carry a sensor: which car is connected is another in every episode."""
        models, actors = self._world.models, self._world.actors()
        for body in self._world.agents().values():
            label = actors.label[actors.id == body.actor_id] if body.actor_id is not None else []
            shapes: list[tuple[float, Model | None]]
            shapes = [(float(model.size_m[2]), model) for model in models if model.label in label]
            for height_m, shape in shapes or [(body.height_m, None)]:
                for sensor, lidar in self._lidars[body.kind].items():
                    require_free_mount(sensor, lidar.config, height_m, shape)
                for camera in self._cameras[body.name]:  # which its own body does not blind
                    require_above_ground(f"camera {camera.name!r} of {body.name}", camera.above_m, height_m)

    def _drives(self, body: AgentBody) -> bool:
        return self._options.control == "policy" and body.kind == "cav"


def _mounting(config: LidarConfig, height_m: float) -> LidarMounting:
    """Describe a LiDAR on an agent of this height."""
    pose = config.base_SE3_sensor(height_m)
    return LidarMounting(pose, config.max_range_m, config.columns, config.beams.elevation_rad)
