"""The simulated source: traffic, then sensors, localization and detection, one frame at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from coopsim.data.episode import Episode
from coopsim.detection.simulated import SimulatedDetector
from coopsim.envs.options import SimulationOptions
from coopsim.envs.source import AgentFrame, Frame, FrameSource
from coopsim.localization import Localizer
from coopsim.metrics.log import GroundTruth
from coopsim.rng import stream
from coopsim.sensors.camera import CameraRig
from coopsim.sensors.geometry import SceneGeometry
from coopsim.sensors.lidar import Lidar
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.visibility import Visibility, VisibilityProbe
from coopsim.types import AgentSpec, CameraImage, Ints, Observation, Sweep, seconds_to_ns
from coopsim.world.recorded import PlayedWorld, RecordedWorld
from coopsim.world.scenario import Scenario
from coopsim.world.snapshot import Actors, AgentBody
from coopsim.world.source import WorldSource
from coopsim.world.world import World

LIDAR = "lidar"


class Simulation(FrameSource):
    """Frames of a `World`, as its agents' sensors see it.

    Args:
        name: the environment's id.
        scenario: what is there.
        options: how it is sensed and scored.
        uplink: what the agents' specs say they broadcast.
        episode: a recorded world, to be sensed in place of one that happens now.
    """

    lidars = (LIDAR,)

    def __init__(
        self, name: str, scenario: Scenario, options: SimulationOptions, uplink: str, episode: Episode | None = None
    ) -> None:
        self.name = name
        self._scenario, self._options, self._episode = scenario, options, episode
        self._lidar = Lidar(options.lidar_config)
        self._probe = VisibilityProbe(options.lidar_config)
        self._detector = options.detector or SimulatedDetector()
        self.embedding_dim = self._detector.embedding_dim
        self._rig: CameraRig | None = None
        self.region_m = (options.region_x_m, options.region_y_m)
        self._world = self._make_world(seed=0)
        self.specs = {
            name: AgentSpec(name, body.kind, options.dt_s, uplink, self._drives(body), body.actor_id is not None)
            for name, body in self._world.agents().items()
        }
        self.road_map = self._world.map
        self.capacity = len(self._world.actors()) if episode is None else episode.most_actors

    def _make_world(self, seed: int) -> WorldSource:
        if self._episode is not None:
            return PlayedWorld(self._episode, self._scenario)
        return World(self._scenario, seed, policy_control=self._options.control == "policy")

    @property
    def cameras(self) -> Mapping[str, tuple[int, int]]:  # type: ignore[override]
        return CameraRig.sizes() if self._options.cameras else {}

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        world = self._make_world(seed)
        if self._options.record is not None:
            world = RecordedWorld(world, self._options.record, self._scenario, seed, self._options.dt_s)
        self._time_ns, self._cycle, self._world = 0, 0, world
        self._geometry = SceneGeometry(world.models, world.static)
        localization = self._options.localization
        self._localizers = {
            name: Localizer(localization, seed, name, stands=spec.kind == "rsu") for name, spec in self.specs.items()
        }
        self._lidar_rngs = {name: stream(seed, "lidar", name) for name in self.specs}
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
            self._rig = CameraRig(self._world.models, self._world.static, renderer=self._options.renderer)
        return self._rig.render(self._world.actors(), self._world.agents())

    def visibility(self) -> Mapping[str, Visibility]:
        scene, actors, bodies, sweeps = self._sensed
        return {name: self._probe.measure(scene, body, sweeps[name], actors) for name, body in bodies.items()}

    def close(self) -> None:
        if self._rig is not None:
            self._rig.close()
            self._rig = None

    def _sense(self) -> Frame:
        actors, bodies = self._world.actors(), self._world.agents()
        scene = RayScene(self._geometry.triangles(actors))
        sweeps = {name: self._sweep(scene, body) for name, body in bodies.items()}
        self._sensed = (scene, actors, bodies, sweeps)
        seen = _hit_ids(sweeps.values())
        images = self.photograph() if self._options.cameras else {}
        agents = {
            name: self._perceive(body, actors, seen, sweeps[name], images.get(name, {}))
            for name, body in bodies.items()
        }
        return Frame(self._time_ns, agents, actors, last=self._cycle >= self._options.max_cycles)

    def _sweep(self, scene: RayScene, body: AgentBody) -> Sweep:
        return self._lidar.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, self._lidar_rngs[body.name])

    def _perceive(
        self,
        body: AgentBody,
        actors: Actors,
        seen: Ints,
        sweep: Sweep,
        images: Mapping[str, CameraImage],
    ) -> AgentFrame:
        others = actors if body.actor_id is None else actors[actors.id != body.actor_id]
        around = others.transform(body.world_SE3_base.inverse())
        pose, odometry = self._localizers[body.name].localize(body.world_SE3_base)
        detections = self._detector.detect({LIDAR: sweep}, around, self._detector_rngs[body.name])
        blind = Sweep(sweep.points, sweep.intensity, sweep.beam)
        observation = Observation(self._time_ns, pose, odometry, detections, {LIDAR: blind}, images)
        assert sweep.instance is not None
        mine = np.isin(around.id, sweep.instance)
        seen_by = np.where(mine, 0, np.where(np.isin(around.id, seen), 1, 2))
        counts = (seen_by < 2) | (self._options.ground_truth == "all")
        counts &= (np.abs(around.boxes.center[:, :2]) <= self.region_m).all(axis=1)
        truth = GroundTruth(around.id[counts], around.boxes[counts], around.label[counts], seen_by[counts])
        return AgentFrame(
            observation,
            body,
            truth,
            around.boxes[~counts],
            around.label[~counts],
            {LIDAR: sweep.instance},
        )

    def _drives(self, body: AgentBody) -> bool:
        return self._options.control == "policy" and body.kind == "cav"


def _hit_ids(sweeps: Iterable[Sweep]) -> Ints:
    """Ids of everything that at least one return came from."""
    hits = [sweep.instance for sweep in sweeps if sweep.instance is not None]
    return np.unique(np.concatenate(hits)) if hits else np.zeros(0, dtype=np.int64)
