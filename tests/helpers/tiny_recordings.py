"""Tiny folders of recordings, written field by field as their formats are described: 2 agents x 3 frames each.

All show one scene, in coopsim's axes: a car (id 7) drives along x, 2 m/s, past a parked one (id 8); agent A stands at
the origin and looks along x, agent B at (20, 5) and looks along -x. Their LiDARs tilt by `PITCH_DEG` where a format
allows it, and see the corners of both cars and a few points of the ground.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from coopsim.data.files.carla_axes import mirror, to_carla_pose
from coopsim.data.files.pcd import encode_rgb_pcd
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3

FRAMES = 3
STEP_S = 0.1
LIDAR_M = 1.9
PITCH_DEG = 2.0
SIZE = (4.6, 1.9, 1.5)
IDS = (7, 8)
SPEED_M_S = 2.0

WORLD_SE3_BASES = (SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.0), SE3.from_xyz_yaw([20.0, 5.0, 0.0], np.pi))


def boxes(frame: int) -> Boxes3D:
    """The two cars, in the world frame."""
    moved = SPEED_M_S * STEP_S * frame
    return Boxes3D.from_array([[10.0 + moved, 3.0, 0.75, *SIZE, 0.2], [12.0, -4.0, 0.75, *SIZE, -1.0]])


def tilted(pitch_deg: float, height_m: float = LIDAR_M) -> SE3:
    """The pose of a LiDAR in the base frame."""
    cos, sin = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    return SE3(np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]), np.array([0.0, 0.0, height_m]))


def cloud(frame: int, world_SE3_base: SE3, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Points in the base frame, on the cars' sides and the ground, and their intensities."""
    rng = np.random.default_rng(frame)
    near = world_SE3_base.inverse().apply(boxes(frame).corners.reshape(-1, 3))
    ground = np.column_stack([rng.uniform(-30, 30, (count, 2)), np.zeros(count)])
    points = np.concatenate([near, ground]).astype(np.float32)
    return points, (np.arange(len(points)) % 256 / 255).astype(np.float32)


def write_opv2v(folder: Path, agents: tuple[str, str] = ("101", "202"), **changed: Any) -> Path:
    """Write a scenario "s1"; `changed` are fields of every frame's YAML, or None for those to leave out."""
    for agent, world_SE3_base in zip(agents, WORLD_SE3_BASES, strict=True):
        place = folder / "train" / "s1" / agent
        place.mkdir(parents=True)
        base_SE3_lidar = tilted(PITCH_DEG)
        for frame in range(FRAMES):
            stamp = f"{68 + 2 * frame:06d}"
            fields: dict[str, Any] = {
                "lidar_pose": to_carla_pose(world_SE3_base.compose(base_SE3_lidar)).tolist(),
                "true_ego_pos": to_carla_pose(world_SE3_base).tolist(),
                "ego_speed": 0.0,
                "vehicles": {key: _opv2v_box(frame, row) for row, key in enumerate(IDS)},
            }
            fields = {name: value for name, value in (fields | changed).items() if value is not None}
            (place / f"{stamp}.yaml").write_text(yaml.safe_dump(fields))
            points, intensity = cloud(frame, world_SE3_base)
            seen = base_SE3_lidar.inverse().apply(points).astype(np.float32)
            (place / f"{stamp}.pcd").write_bytes(encode_rgb_pcd(mirror(seen), intensity))
    return folder


def _opv2v_box(frame: int, row: int) -> dict[str, Any]:
    box = boxes(frame).array[row]
    return {
        "angle": [0.0, float(-np.degrees(box[6])), 0.0],
        "center": [0.0, 0.0, float(box[2])],
        "extent": (box[3:6] / 2).tolist(),
        "location": [float(box[0]), float(-box[1]), 0.0],
        "speed": 0.0,
    }


def write_v2v4real(folder: Path) -> Path:
    """Write a scenario "s1" whose YAML has NumPy's tags. Each car lists the cars under other ids."""
    for place, world_SE3_base in enumerate(WORLD_SE3_BASES):
        target = folder / "s1" / str(place)
        target.mkdir(parents=True)
        base_SE3_lidar = tilted(PITCH_DEG)
        world_SE3_lidar = world_SE3_base.compose(base_SE3_lidar)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = world_SE3_lidar.rotation, world_SE3_lidar.translation
        for frame in range(FRAMES):
            vehicles = {}
            there = boxes(frame)
            middle = world_SE3_lidar.inverse().apply(there.center)
            for row in range(2):
                yaw = there.yaw[row] - world_SE3_base.yaw
                vehicles[row + 10 * place] = {
                    "ass_id": np.int64(IDS[row] - 1),
                    "obj_type": "Car",
                    "location": middle[row],
                    "center": [0.0, 0.0, 0.0],
                    "extent": (np.array(SIZE) / 2).tolist(),
                    "angle": (0.0, float(np.degrees(yaw)), 0.0),
                }
            stem = target / f"{frame:06d}"
            stem.with_suffix(".yaml").write_text(yaml.dump({"lidar_pose": matrix, "vehicles": vehicles}))
            points, intensity = cloud(frame, world_SE3_base)
            seen = base_SE3_lidar.inverse().apply(points).astype(np.float32)
            stem.with_suffix(".pcd").write_bytes(encode_rgb_pcd(seen, intensity))
    return folder
