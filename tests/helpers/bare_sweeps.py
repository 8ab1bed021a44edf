"""Sweeps without labels: those of a LiDAR at a known place amid ground and walls that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from sensor_scenes import actors, box_part, ground, triangles

from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.scene import RayScene
from coopsim.support.rng import stream

ORIGIN_M = np.array([1.2, -0.1, 1.9])
COLUMNS = 360


def bare_sweep(*walls: object, columns: int = COLUMNS) -> np.ndarray:
    """Return the points (N, 4) of an HDL-32E at `ORIGIN_M` on flat ground, with a wall at x = 25 m and further ones."""
    far = box_part([26, 0, 5], (2, 60, 10))
    config = LidarConfig("HDL-32E", columns, x_m=ORIGIN_M[0], y_m=ORIGIN_M[1], range_noise_m=0.01, dropout_energy=0.0)
    scene = RayScene(triangles(actors([]), [ground(), far, *walls]))  # type: ignore[list-item]
    height_m = ORIGIN_M[2] - config.above_m
    sweep = Lidar(config).sense(scene, SE3.identity(), height_m, None, stream(0, "bare"))
    return np.column_stack([sweep.points, sweep.intensity]).astype(np.float32)


def write_bare(folder: Path, frames: int = 1, step_s: float | None = None) -> Path:
    """Write frames of plain arrays without labels; with a step, of a car that drives 1 m in each. Return the folder."""
    folder.mkdir()
    for k in range(frames):
        arrays: dict[str, object] = {"points": bare_sweep(box_part([4, -9, 1.5], (30, 1, 3)))}
        if step_s is not None:
            pose = np.eye(4)
            pose[0, 3] = k
            arrays |= {"pose": pose, "time_s": k * step_s}
        np.savez(folder / f"drive_{k:03d}.npz", **arrays)  # type: ignore[arg-type]
    return folder
