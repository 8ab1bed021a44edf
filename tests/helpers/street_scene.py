"""A street with a few boxy cars in points, for tests of policies on points without an environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.geometry.se3 import SE3
from coopsim.types import (
    AgentSpec,
    Detections,
    LidarMounting,
    Message,
    Observation,
    Odometry,
    PoseEstimate,
    SensorView,
    Sweep,
)

FRAME_NS = 100_000_000
CARS = ((12.0, 4.0), (25.0, -6.0), (-18.0, 3.0), (38.0, 12.0))


def car_points(xy: tuple[float, float], count: int = 300, seed: int = 0) -> np.ndarray[Any, Any]:
    """(N, 3) on the sides of a car in the world."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 3)) * [2.2, 0.9, 0.6] + [0, 0, 0.9]
    side = np.arange(count) % 2 == 0
    points[side, 1] = np.sign(points[side, 1]) * 0.9
    return points + np.array([*xy, 0.0])


def sweep_from(xyz_yaw: Any, cars: Any = CARS) -> Sweep:
    """What a LiDAR at this pose sees of cars and of the ground, in its base frame."""
    rng = np.random.default_rng(7)
    ground = np.column_stack([rng.uniform(-40, 40, (500, 2)), np.zeros(500)])
    world = np.concatenate([ground, *(car_points(xy, seed=k) for k, xy in enumerate(cars))])
    pose = np.asarray(xyz_yaw, dtype=float)
    points = SE3.from_xyz_yaw(pose[:3], pose[3]).inverse().apply(world).astype(np.float32)
    return Sweep(points, np.full(len(points), 0.4, np.float32), np.zeros(len(points), np.int64))


def view_of(sweep: Sweep) -> SensorView:
    """What an agent with one LiDAR sees, whose axes are the world's."""
    return SensorView("cav_0", 0, Odometry(np.zeros(4)), {"lidar": sweep})


def observe(
    time_ns: int, *inbox: Message, pose: Any = (0, 0, 0, 0), cars: Any = CARS, sweep: Sweep | None = None
) -> Observation:
    """An agent that stands still and is sure where."""
    seen = sweep_from(pose, cars) if sweep is None else sweep
    return Observation(
        time_ns,
        PoseEstimate(np.asarray(pose, dtype=float)),
        Odometry(np.zeros(4)),
        Detections.empty(),
        {"lidar": seen},
        inbox=inbox,
    )


def spec_of(name: str, kind: Any = "cav", uplink: str = "features") -> AgentSpec:
    roof = LidarMounting(SE3.from_xyz_yaw(np.array([0, 0, 1.8]), 0.0), 100.0, 1024, np.radians([-10.0, 0.0]))
    return AgentSpec(name, kind, 0.1, uplink, is_object=kind == "cav", lidars={"lidar": roof})
