"""Frames to export, from an environment: one at a time, so that memory does not grow with their number."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.catalog import parallel_env
from coopsim.data.export.export_frame import CameraShot, ExportAgent, ExportFrame, LidarScan
from coopsim.data.export.export_plan import ExportPlan
from coopsim.errors import InvalidValueError
from coopsim.support.arrays import look_up
from coopsim.types import AgentSpec, CameraImage, GroundTruth, Ints, LidarMounting, Sweep
from coopsim.world.snapshot import RoadMap

if TYPE_CHECKING:
    from coopsim.envs.frames import AgentFrame, Frame

_REPLAY = re.compile(r"(coopsim/)?replay(-v\d+)?")
_FIXED = {"uplink": "none", "expose_ground_truth": True, "sense_every": 1, "seed": None}
_USUAL = {"detector": "none", "camera_modes": ("rgb",)}  # detections are not exported


class ExportSource:
    """The environment of a plan, and its episodes as frames to export. Close it at the end.

    Args:
        plan: says which environment, with which options.
        usual: options that hold unless the plan gives others.

    Raises:
        CoopsimError: as `coopsim.parallel_env` does; or the environment is a replay, which has no sensors.
    """

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
    """Return a frame of an environment as a frame to export.

    Args:
        frame: of a simulated environment.
        specs: the agents, of the running episode.
        seed: of the episode.
        index: of the frame in it.
    """
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
