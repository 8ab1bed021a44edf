"""Clips without a simulator: boxes on a plane, with points on their sides that every agent sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.support.rng import stream
from coopsim.types import ObjectClass


@dataclass(frozen=True)
class SyntheticClips:
    """Clips of cars that drive east."""

    agents: int = 2
    objects: int = 4
    frames: int = 2
    reach_m: float = 16.0
    noise_m: float = 0.02

    def clip(self, index: int) -> Clip:
        rng = stream(7, "synthetic", str(index))
        boxes = np.column_stack(
            [
                rng.uniform(-self.reach_m, self.reach_m, (self.objects, 2)),
                np.full(self.objects, 0.8),
                np.tile([4.5, 1.9, 1.6], (self.objects, 1)),
                rng.uniform(-np.pi, np.pi, self.objects),
            ]
        )
        scenes = tuple(self._scene(boxes + 0.5 * k * np.eye(7)[0], k, rng) for k in range(self.frames))
        return Clip(f"synthetic {index}", 0.1, scenes)

    def _scene(self, boxes: np.ndarray, number: int, rng: np.random.Generator) -> Scene:
        poses = np.column_stack(
            [rng.uniform(-4, 4, (self.agents, 2)), np.zeros(self.agents), rng.uniform(-np.pi, np.pi, self.agents)]
        )
        agents = tuple(
            AgentScene(f"rsu_{k}", "rsu", pose, np.zeros(4), self._points(boxes, pose, rng), None)
            for k, pose in enumerate(poses)
        )
        count = len(boxes)
        return Scene(
            100_000_000 * number, agents, np.arange(count), boxes, np.tile([5.0, 0.0], (count, 1)),
            np.full(count, int(ObjectClass.CAR)), np.full((count, self.agents), 40),
        )  # fmt: skip

    def _points(self, boxes: np.ndarray, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return points (P, 4) on the boxes and on the ground, in the base frame of a pose."""
        unit = rng.uniform(-0.5, 0.5, (len(boxes), 40, 3))
        unit[:, :20, 0] = np.sign(unit[:, :20, 0]) / 2
        unit[:, 20:, 1] = np.sign(unit[:, 20:, 1]) / 2
        local = unit * boxes[:, None, 3:6]
        cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
        turned = np.stack(
            [cos * local[..., 0] - sin * local[..., 1], sin * local[..., 0] + cos * local[..., 1], local[..., 2]],
            axis=-1,
        )
        ground = np.column_stack([rng.uniform(-self.reach_m, self.reach_m, (200, 2)), np.zeros(200)])
        xyz = np.concatenate([(turned + boxes[:, None, :3]).reshape(-1, 3), ground])
        xyz += rng.normal(0, self.noise_m, xyz.shape)
        dx, dy = (xyz[:, :2] - pose[:2]).T
        cos, sin = np.cos(pose[3]), np.sin(pose[3])
        seen = np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy, xyz[:, 2], np.full(len(xyz), 0.5)])
        return seen.astype(np.float32)
