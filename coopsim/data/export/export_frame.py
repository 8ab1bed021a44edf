"""Plan, source and frames of an export, in coopsim's axes and units."""

from __future__ import annotations

import hashlib
import json
import re
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coopsim.catalog import is_scenario_file, parallel_env
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import look_up
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed
from coopsim.types import (
    AgentSpec,
    CameraCalibration,
    CameraImage,
    GroundTruth,
    Ints,
    LidarMounting,
    PoseEstimate,
    Sweep,
)
from coopsim.version import __version__
from coopsim.world.snapshot import AgentBody, RoadMap

if TYPE_CHECKING:
    from coopsim.envs.frames import AgentFrame, Frame


_PACKAGES = ("numpy", "numba", "scipy", "pillow")


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """The arguments of an export.

    Attributes:
        format: the format's spec, as "opv2v" or "kitti(agent=cav_1)".
        environment: name, or path of a scenario file.
        seeds: seeds of the episodes, in order, each once.
        frames: number of frames of each episode.
        options: further options of the environment; plain data.
    """

    format: str
    environment: str
    seeds: tuple[int, ...]
    frames: int
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_count(1, frames=self.frames)
        for seed in self.seeds:
            require_seed(seed)
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise InvalidValueError(f"seeds must be distinct, at least one, got {reprlib.repr(self.seeds)}")
        try:
            json.dumps(dict(self.options))
        except TypeError as error:
            raise InvalidValueError(f"options must be plain data (numbers, texts, lists, mappings): {error}") from error

    @property
    def name(self) -> str:
        """The environment's name as a part of names of folders and scenes, as "crossing" or "rush_hour"."""
        name = Path(self.environment).stem if is_scenario_file(self.environment) else self.environment
        return "".join(letter if letter.isalnum() else "_" for letter in name.rpartition("/")[2])

    def episode_name(self, seed: int) -> str:
        """Return the name of an episode, as "crossing_0007"; names sort as seeds do up to 9999."""
        return f"{self.name}_{seed:04d}"

    def facts(self) -> dict[str, Any]:
        """Return the plan and the versions that decide its bytes, as JSON has them."""
        facts: dict[str, Any] = {
            "format": self.format,
            "environment": self.environment,
            "seeds": list(self.seeds),
            "frames": self.frames,
            "options": dict(self.options),
            "versions": {"coopsim": __version__, **{name: version(name) for name in _PACKAGES}},
        }
        if is_scenario_file(self.environment) and Path(self.environment).is_file():
            facts["scenario_file_sha256"] = hashlib.sha256(Path(self.environment).read_bytes()).hexdigest()
        loaded: dict[str, Any] = json.loads(json.dumps(facts))
        return loaded


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan:
    """Revolution of a LiDAR, in the sensor's own frame.

    Attributes:
        mounting: the LiDAR's place on the agent (`base_SE3_lidar`), its range and rays.
        points: (P, 3) m, float32, in the LiDAR's frame: x forward, y left, z up of the sensor, which a drone's pitches.
        intensity: (P,) in [0, 1], float32.
        beam: (P,) row of the beam table, int64.
        instance: (P,) id of the actor that was hit, 0 for the static scene and -1 for clutter.
    """

    mounting: LidarMounting
    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    beam: Ints
    instance: Ints


@dataclass(frozen=True, slots=True, eq=False)
class CameraShot:
    """The picture of one camera.

    Attributes:
        calibration: intrinsics, distortion and place on the agent (`base_SE3_camera`).
        image: in the environment's `camera_modes`: `rgb`, unless an option asks for `depth`, `instance` or `semantic`.
    """

    calibration: CameraCalibration
    image: CameraImage


@dataclass(frozen=True, slots=True, eq=False)
class ExportAgent:
    """Agent in a frame.

    Attributes:
        spec: name, kind ("cav", "rsu" or "drone") and sensors; the same in all frames of an episode.
        body: true pose `world_SE3_base` (origin on the ground under the agent), `actor_id` (None: the agent is no
            object), `height_m`.
        pose: the agent's own estimate of its pose.
        speed_m_s: true speed over ground; 0 for an agent that is no object.
        lidars: scans by name; empty for an agent without LiDAR.
        cameras: shots by name; empty unless the option `cameras` is on.
    """

    spec: AgentSpec
    body: AgentBody
    pose: PoseEstimate
    speed_m_s: float
    lidars: Mapping[str, LidarScan]
    cameras: Mapping[str, CameraShot]

    @property
    def name(self) -> str:
        """Name, as `cav_0`, `rsu_0` or `drone_0`."""
        return self.spec.name

    def scan(self, lidar: str | None) -> LidarScan:
        """Return the revolution of the LiDAR of that name; None: of the first."""
        return self.lidars[lidar or next(iter(self.lidars))]

    @property
    def world_SE3_base(self) -> SE3:
        """The true pose."""
        return self.body.world_SE3_base


@dataclass(frozen=True, slots=True, eq=False)
class ExportFrame:
    """Frame of an episode.

    Attributes:
        seed: seed of the episode.
        index: number of the frame, from 0.
        time_ns: since the episode's start.
        agents: in the environment's order.
        objects: all N actors, the agents' cars among them: `id`, `boxes` (world frame), `label`, `velocity` (N, 2) m/s
            (world axes) and `returns` (N, A), the number of LiDAR returns that each of the A agents has from each, its
            own body excepted.
    """

    seed: int
    index: int
    time_ns: int
    agents: tuple[ExportAgent, ...]
    objects: GroundTruth

    @property
    def returns(self) -> Ints:
        """(N, A) number of returns that each agent has from each object."""
        assert self.objects.returns is not None
        return self.objects.returns

    @property
    def velocity(self) -> Floats:
        """(N, 2) m/s, in the axes of the world."""
        assert self.objects.velocity is not None
        return self.objects.velocity


_REPLAY = re.compile(r"(coopsim/)?replay(-v\d+)?")
_FIXED = {"uplink": "none", "expose_ground_truth": True, "sense_every": 1, "seed": None}
_USUAL = {"detector": "none", "camera_modes": ("rgb",)}  # detections are not exported


class ExportSource:
    """Environment of a plan, with episodes as frames to export; its options win over the usual ones. Close it."""

    def __init__(self, plan: ExportPlan, usual: Mapping[str, Any]) -> None:
        if _REPLAY.fullmatch(plan.environment):
            raise InvalidValueError("environment must be a simulated one, got 'replay': a replay has no sensors")
        self._frames = plan.frames
        fixed = {**_FIXED, "max_cycles": max(plan.frames - 1, 1)}  # the first frame takes no step
        for name in fixed:
            if name in plan.options:
                raise InvalidValueError(f"{name} must be left out of an export's options, which sets it")
        self._env = parallel_env(plan.environment, **{**_USUAL, **usual, **plan.options, **fixed})

    @property
    def agents(self) -> Mapping[str, AgentSpec]:
        """The agents, by name; their mountings are those of the running episode."""
        return self._env.agent_specs

    @property
    def road_map(self) -> RoadMap:
        """Outlines of the running episode's place."""
        return self._env.road_map

    def episode(self, seed: int) -> Iterator[ExportFrame]:
        """Yield the frames of an episode."""
        for number, frame in enumerate(islice(self._env.frames(seed), self._frames)):
            yield export_frame(frame, self._env.agent_specs, seed, number)

    def close(self) -> None:
        """Release the environment's resources."""
        self._env.close()


def export_frame(frame: Frame, specs: Mapping[str, AgentSpec], seed: int, index: int) -> ExportFrame:
    """Return a frame of an environment as a frame to export."""
    actors = frame.actors
    agents = tuple(_agent(frame, specs[name], each) for name, each in frame.agents.items())
    returns = np.zeros((len(actors), len(agents)), np.int64)
    order = np.argsort(actors.id)
    for column, each in enumerate(frame.agents.values()):
        if each.truth.returns is not None:  # of all objects but the agent itself
            rows, _ = look_up(actors.id[order], each.truth.id)
            returns[order[rows], column] = each.truth.returns[:, column]
    objects = GroundTruth(actors.id, actors.boxes, actors.label, velocity=actors.velocity, returns=returns)
    return ExportFrame(seed, index, frame.time_ns, agents, objects)


def _agent(frame: Frame, spec: AgentSpec, agent: AgentFrame) -> ExportAgent:
    observed, body = agent.observation, agent.body
    (speed,) = np.linalg.norm(frame.actors.velocity[frame.actors.id == body.actor_id], axis=1).tolist() or [0.0]
    return ExportAgent(
        spec=spec,
        body=body,
        pose=observed.pose,
        speed_m_s=speed,
        lidars={
            name: _scan(sweep, spec.lidars[name], agent.instances[name]) for name, sweep in observed.sweeps.items()
        },
        cameras={
            name: CameraShot(spec.cameras[name], _whole(image, agent.segmentation[name]))
            for name, image in observed.cameras.items()
        },
    )


def _scan(sweep: Sweep, mounting: LidarMounting, instance: Ints) -> LidarScan:
    points = mounting.base_SE3_lidar.inverse().apply(sweep.points).astype(np.float32)
    return LidarScan(mounting, points, sweep.intensity, sweep.beam, instance)


def _whole(image: CameraImage, truth: CameraImage) -> CameraImage:
    return CameraImage(image.rgb, image.depth, truth.instance, truth.semantic)
