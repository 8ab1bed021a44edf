"""A frame to export: everything that a format may want of it, in coopsim's axes and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import AgentSpec, CameraCalibration, CameraImage, GroundTruth, Ints, LidarMounting, PoseEstimate
from coopsim.world.snapshot import AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan:
    """One revolution of one LiDAR, in the sensor's own frame.

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
    """One agent in one frame.

    Attributes:
        spec: name, kind ("cav", "rsu" or "drone") and sensors; the same in all frames of an episode.
        body: true pose `world_SE3_base` (origin on the ground under the agent), `actor_id` (None: the agent is no
            object), `height_m`.
        pose: the agent's own estimate of its pose.
        speed_m_s: true speed over ground; 0 for an agent that is no object.
        lidars: by name; empty for an agent without LiDAR.
        cameras: by name; empty unless the option `cameras` is on.
    """

    spec: AgentSpec
    body: AgentBody
    pose: PoseEstimate
    speed_m_s: float
    lidars: Mapping[str, LidarScan]
    cameras: Mapping[str, CameraShot]

    @property
    def name(self) -> str:
        """As `cav_0`, `rsu_0` or `drone_0`."""
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
    """One frame of an episode.

    Attributes:
        seed: of the episode.
        index: of the frame, from 0.
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
