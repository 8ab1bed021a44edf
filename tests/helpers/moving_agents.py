"""Clips of agents that drive and turn among cars: these stand, or drive east."""

from __future__ import annotations

import numpy as np
from street_scene import CARS, sweep_from

from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.types import ObjectClass, Odometry, stack_xyz_yaw


def pose_at(agent: int, frame: int) -> SE3:
    """Return where an agent is in a frame; each drives its own way, and turns."""
    yaw = 0.3 + agent + 0.1 * frame
    return SE3.from_xyz_yaw(np.array([4.0 * agent + 7.0 * frame, 3.0 * agent - 4.0 * frame, 0.0]), yaw)


def odometry_at(agent: int, frame: int) -> Odometry:
    """Return its motion since the frame before."""
    if not frame:
        return Odometry(np.zeros(4))
    return Odometry(stack_xyz_yaw(pose_at(agent, frame - 1).inverse().compose(pose_at(agent, frame))))


def clip_of_moving_agents(frames: int = 4, agents: int = 2, dt_s: float = 0.1, step_m: float = 0.0) -> Clip:
    """Return a clip whose cars drive `step_m` in each frame, and have returns of all agents."""
    return Clip("moving agents", dt_s, tuple(_scene(k, agents, dt_s, step_m) for k in range(frames)))


def _scene(number: int, agents: int, dt_s: float, step_m: float) -> Scene:
    cars = np.add(CARS, (step_m * number, 0.0))
    made = []
    for agent in range(agents):
        pose = pose_at(agent, number)
        sweep = sweep_from(stack_xyz_yaw(pose), [tuple(xy) for xy in cars])
        points = np.column_stack([sweep.points, sweep.intensity]).astype(np.float32)
        odometry = odometry_at(agent, number).xyz_yaw
        made.append(AgentScene(f"rsu_{agent}", "rsu", stack_xyz_yaw(pose), odometry, points, None))
    boxes = np.column_stack([cars, np.tile([0.9, 4.4, 1.8, 1.5, 0.0], (len(cars), 1))])
    velocity = np.tile([step_m / dt_s, 0.0], (len(cars), 1))
    return Scene(
        round(number * dt_s * 1e9), tuple(made), np.arange(len(cars)), boxes, velocity,
        np.full(len(cars), int(ObjectClass.CAR)), np.full((len(cars), agents), 300),
    )  # fmt: skip
