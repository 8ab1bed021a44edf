"""Clips without a simulator whose agents have small cameras: boxes and a plane, seen along each pixel's ray."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from small_cameras import BENT
from synthetic_clips import SyntheticClips

from coopsim.learn.clips.clip import BLOCK, AgentScene, Picture, Scene, nearest_in_blocks
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics

NO_CLASS = 255
BODY_M = 2.0
"""Height of the bodies on which cameras stand."""

RIG = (
    Camera("front", Intrinsics.from_fov(44, 28), yaw_rad=0.1, pitch_rad=0.15, roll_rad=0.05),
    Camera("rear", Intrinsics.from_fov(48, 32, distortion=BENT), y_m=0.3, yaw_rad=2.8, pitch_rad=0.1),
)
"""Cameras whose pictures have different sizes, one of them of parts of cells, and a lens that distorts."""


@dataclass(frozen=True)
class PicturedClips(SyntheticClips):
    """Clips of cars that drive east, with pictures.

    Attributes:
        rig: cameras of every agent.
    """

    rig: tuple[Camera, ...] = RIG

    def _scene(self, boxes: np.ndarray, number: int, rng: np.random.Generator) -> Scene:
        scene = super()._scene(boxes, number, rng)
        agents, pixels = [], []
        for agent in scene.agents:
            pictures, counts = zip(*(photograph(each, agent, boxes, scene.label) for each in self.rig), strict=True)
            agents.append(replace(agent, pictures=pictures))
            pixels.append(np.sum(counts, axis=0))
        return replace(scene, agents=tuple(agents), pixels=np.stack(pixels, axis=1))


def photograph(
    camera: Camera, agent: AgentScene, boxes: np.ndarray, label: Sequence[int]
) -> tuple[Picture, np.ndarray]:
    """Return a camera's picture of boxes (N, 7) on the ground, coloured by number, and each one's pixels (N,)."""
    calibration = camera.calibration(BODY_M)
    pose, size = calibration.base_SE3_camera, calibration.size
    rays, start = camera.intrinsics.rays @ pose.rotation.T, pose.translation
    depth = np.where(rays[:, 2] < -1e-6, -start[2] / np.minimum(rays[:, 2], -1e-6), np.inf)
    depth[depth > 200] = np.inf
    nearest = np.full(len(rays), -1)
    for number, box in enumerate(boxes):
        met = _entry(start, rays, box, agent.xyz_yaw)
        depth, nearest = np.minimum(depth, met), np.where(met < depth, number, nearest)
    classes = np.where(nearest < 0, NO_CLASS, np.asarray(label)[nearest]).astype(np.uint8)
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    colours = np.random.default_rng(0).integers(100, 256, (len(boxes) + 1, 3)).astype(np.uint8)
    colours[-1] = 60
    rgb = np.where((depth == 0)[:, None], np.uint8(20), colours[nearest]).reshape(*size, 3)
    near_m, shown = nearest_in_blocks(depth.reshape(size), classes.reshape(size), BLOCK)
    picture = Picture(calibration, rgb, near_m.astype(np.float16), shown)
    return picture, np.bincount(nearest[nearest >= 0], minlength=len(boxes))


def _entry(start: np.ndarray, rays: np.ndarray, box: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return the depth (R,) at which rays (R, 3) of an agent's frame enter a box of the world; inf: they do not."""
    turn, out = pose[3] - box[6], np.zeros(3)
    cos, sin = np.cos(turn), np.sin(turn)
    away = pose[:2] - box[:2]
    out[:2] = [
        np.cos(box[6]) * away[0] + np.sin(box[6]) * away[1],
        -np.sin(box[6]) * away[0] + np.cos(box[6]) * away[1],
    ]
    out[2] = pose[2] - box[2]
    turned = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    here, ways = turned @ start + out, rays @ turned.T
    ways = np.where(np.abs(ways) < 1e-9, 1e-9, ways)
    ends = np.stack([(side * box[3:6] / 2 - here) / ways for side in (-1, 1)])
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)
