"""Clips with traffic on the left: the same clips, seen in a mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import AgentScene, Clip, Scene


def in_mirror(clip: Clip) -> Clip:
    """Return a clip without images in which y is -y in the world and in all agents' frames.

    It is exact: a mirrored sweep is the one of a LiDAR that turns the other way round in a mirrored world. Numbers of
    returns and intensities stay.
    """
    return replace(clip, scenes=tuple(_scene(scene) for scene in clip.scenes))


def _scene(scene: Scene) -> Scene:
    return replace(
        scene,
        agents=tuple(_agent(agent) for agent in scene.agents),
        boxes=_turned(scene.boxes, 6),
        velocity=scene.velocity * [1.0, -1.0],
    )


def _agent(agent: AgentScene) -> AgentScene:
    points = agent.points * np.array([1, -1, 1, 1], np.float32)
    return replace(agent, xyz_yaw=_turned(agent.xyz_yaw, 3), odometry=_turned(agent.odometry, 3), points=points)


def _turned(rows: Floats, yaw: int) -> Floats:
    """Return rows (..., K) that have y in column 1 and a heading in column `yaw`, in the mirror."""
    turned = rows.copy()
    turned[..., 1] *= -1
    turned[..., yaw] = np.where(rows[..., yaw] > -np.pi, -rows[..., yaw], -np.pi)  # headings are below pi
    return turned
