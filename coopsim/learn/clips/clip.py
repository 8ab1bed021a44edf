"""What the simulator gives to training: clips of scenes, each with what all agents sense and the truth around them.

No tensors and no torch here, and nothing of the environment: a clip is plain arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import CameraCalibration, Ints

BLOCK = 4
"""Pixels along either edge of the blocks of which a picture keeps the nearest surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One camera's picture in one frame.

    Depth and class are kept coarsely, of the nearest surface in each block of `BLOCK` x `BLOCK` pixels; blocks at the
    right and the lower edge may have fewer pixels.

    Attributes:
        calibration: the camera's intrinsics and its place on the agent.
        rgb: (H, W, 3) uint8.
        depth_m: (ceil(H / BLOCK), ceil(W / BLOCK)) float16, m along the optical axis; 0: nothing.
        label: the same shape, uint8, the surface's `ObjectClass`; 255: scenery or sky.
    """

    calibration: CameraCalibration
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float16]
    label: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class AgentScene:
    """One agent in one frame.

    Attributes:
        name: as `cav_0`.
        kind: "cav", "rsu" or "drone".
        xyz_yaw: (4,) its true pose in the world frame: x, y, z m and heading rad.
        odometry: (4,) its own estimate of the motion since the clip's frame before, in the base frame of then.
        points: (P, 4) float32: x, y, z m in the base frame and intensity in [0, 1], of all its LiDARs.
        actor_id: its own id among the scene's objects; None: it is no object, as a mast.
        pictures: of its cameras, in the rig's order; empty without cameras.
    """

    name: str
    kind: str
    xyz_yaw: Floats
    odometry: Floats
    points: NDArray[np.float32]
    actor_id: int | None
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One frame: A agents, and all N objects, whether seen or not, the agents that are objects among them.

    Attributes:
        time_ns: since the clip's start.
        agents: in the environment's order.
        object_id: (N,).
        boxes: (N, 7) x, y, z, l, w, h, yaw in the world frame.
        velocity: (N, 2) m/s over ground, in the world's axes.
        label: (N,) an `ObjectClass`.
        returns: (N, A) number of LiDAR returns that each agent has from each object; of itself 0.
        pixels: (N, A) number of pixels that each agent has of each object, in all its pictures; of itself 0. None:
            there are no cameras.
    """

    time_ns: int
    agents: tuple[AgentScene, ...]
    object_id: Ints
    boxes: Floats
    velocity: Floats
    label: Ints
    returns: Ints
    pixels: Ints | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """Consecutive scenes of one episode.

    Attributes:
        key: says where it came from, and is equal only for clips of equal content: as "town seed 7, clip 31".
        dt_s: time between two scenes.
        scenes: in order of time.
    """

    key: str
    dt_s: float
    scenes: tuple[Scene, ...]
