"""Clips of scenes: measurements of all agents and the truth around them, as plain arrays without torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.types import CameraCalibration, Ints

BLOCK = 4
"""Edge in pixels of the blocks of an image whose nearest surface is kept."""

NO_CLASS = 255
"""Label of scenery and sky."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Image of a camera in a frame.

    Depth and class are kept coarsely, of the nearest surface in each block of `BLOCK` x `BLOCK` pixels; blocks at the
    right and the lower edge may have fewer pixels.

    Attributes:
        calibration: intrinsics, and pose on the agent.
        rgb: (H, W, 3) uint8.
        depth_m: (ceil(H / BLOCK), ceil(W / BLOCK)) float16, m along the optical axis; 0: nothing.
        label: (ceil(H / BLOCK), ceil(W / BLOCK)) uint8, `ObjectClass` of the surface; 255: scenery or sky.
    """

    calibration: CameraCalibration
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float16]
    label: NDArray[np.uint8]


def nearest_in_blocks(
    depth_m: NDArray[np.float32], label: NDArray[np.uint8], edge: int
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return depth (m; 0: nothing) and class of the nearest surface in each block of `edge` x `edge` pixels."""
    rows, columns = (-(-length // edge) for length in depth_m.shape)
    missing = [(0, -length % edge) for length in depth_m.shape]

    def blocks(pixels: NDArray[Any], outside: float) -> NDArray[Any]:
        padded = np.pad(pixels, missing, constant_values=outside)
        return padded.reshape(rows, edge, columns, edge).swapaxes(1, 2).reshape(rows, columns, edge**2)

    far = blocks(np.where(depth_m > 0, depth_m, np.float32(np.inf)), np.inf)
    nearest = far.argmin(axis=-1)[..., None]
    depth = np.take_along_axis(far, nearest, axis=-1)[..., 0]
    depth[np.isinf(depth)] = 0.0
    return depth, np.take_along_axis(blocks(label, NO_CLASS), nearest, axis=-1)[..., 0]


@dataclass(frozen=True, slots=True, eq=False)
class AgentScene:
    """Agent in a frame.

    Attributes:
        name: name of the agent, such as `cav_0`.
        kind: "cav", "rsu" or "drone".
        xyz_yaw: (4,) true pose in the world frame: x, y, z m and heading rad.
        odometry: (4,) own estimate of the motion since the clip's frame before, in the base frame of then.
        points: (P, 4) float32: x, y, z m in the base frame and intensity in [0, 1], from all its LiDARs.
        actor_id: id among the scene's objects; None: a roadside unit, which is no object.
        pictures: images in the rig's order; empty without cameras.
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
    """A frame: A agents in the environment's order, and all N objects, seen or not, connected cars among them.

    Attributes:
        time_ns: time since the clip's start.
        agents: the A agents.
        object_id: (N,) ids.
        boxes: (N, 7) x, y, z, l, w, h, yaw in the world frame.
        velocity: (N, 2) m/s over ground, in the world's axes.
        label: (N,) `ObjectClass`.
        returns: (N, A) number of LiDAR returns from each object at each agent; 0 from itself.
        pixels: (N, A) number of pixels of each object in all images of each agent; 0 of itself. None: no cameras.
        doubtful: (K, 7) boxes where an object may be that is not among these; None: nowhere.
    """

    time_ns: int
    agents: tuple[AgentScene, ...]
    object_id: Ints
    boxes: Floats
    velocity: Floats
    label: Ints
    returns: Ints
    pixels: Ints | None = None
    doubtful: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """Consecutive scenes of one episode.

    Attributes:
        key: origin, equal only for clips of equal content, such as "town seed 7, clip 31".
        dt_s: time between two scenes.
        scenes: scenes in order of time.
    """

    key: str
    dt_s: float
    scenes: tuple[Scene, ...]


class ClipSource(Protocol):
    """Clips by number, such as `SimulatedClips`; of other things than `Clip` where a task reads these."""

    def clip(self, index: int) -> Any:
        """Return a clip: the same for the same index."""
