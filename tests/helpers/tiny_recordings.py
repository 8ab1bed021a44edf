"""Tiny folders of recordings, written field by field as their formats are described: 3 frames of 2 agents (KITTI: 1).

All show one scene, in coopsim's axes: a car (id 7) drives along x, 2 m/s, past a parked one (id 8); agent A stands at
the origin and looks along x, agent B at (20, 5) and looks along -x. Their LiDARs tilt by `PITCH_DEG` where a format
allows it, and see the corners of both cars and a few points of the ground.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from coopsim.data.files.carla_axes import mirror, to_carla_pose
from coopsim.data.files.pcd import encode_intensity_pcd, encode_rgb_pcd
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3

FRAMES = 3
STEP_S = 0.1
LIDAR_M = 1.9
SPD_LIDAR_M = 1.7
KITTI_LIDAR_M = 1.73
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


def write_spd(folder: Path) -> Path:
    """Write one sequence; the world's origin is far away, and the roadside unit's clouds are 20 ms older."""
    far = SE3.from_xyz_yaw([1_000_000.0, 500_000.0, 20.0], 0.7)
    lidar_SE3_novatel = tilted(PITCH_DEG, 0.4).inverse()
    lists: dict[str, list[Any]] = {"vehicle-side": [], "infrastructure-side": [], "cooperative": []}
    for frame in range(FRAMES):
        stamp_us = 1_600_000_000_000_000 + round(STEP_S * 1e6) * frame
        for side, number, world_SE3_base, pitch_deg in (
            ("vehicle-side", f"{frame + 10:06d}", WORLD_SE3_BASES[0], PITCH_DEG),
            ("infrastructure-side", f"{frame + 500:06d}", WORLD_SE3_BASES[1], 0.0),
        ):
            base_SE3_lidar = tilted(pitch_deg, SPD_LIDAR_M)
            world_SE3_lidar = far.compose(world_SE3_base).compose(base_SE3_lidar)
            car = side == "vehicle-side"
            calibrations = {"virtuallidar_to_world": _rigid(world_SE3_lidar)}
            if car:
                novatel = world_SE3_lidar.compose(lidar_SE3_novatel)
                calibrations = {
                    "lidar_to_novatel": {"transform": _rigid(lidar_SE3_novatel.inverse())},
                    "novatel_to_world": _rigid(novatel),
                }
            for name, content in calibrations.items():
                _write_json(folder / side / "calib" / name / f"{number}.json", content)
            points, intensity = cloud(frame, world_SE3_base)
            seen = base_SE3_lidar.inverse().apply(points).astype(np.float32)
            _write(folder / side / f"velodyne/{number}.pcd", encode_intensity_pcd(seen, intensity * np.float32(255)))
            time_us = stamp_us if car else stamp_us - 20_000
            about = {"frame_id": number, "pointcloud_timestamp": str(time_us), "sequence_id": "0003"}
            lists[side].append({**about, "pointcloud_path": f"velodyne/{number}.pcd"})
            if car:
                there = boxes(frame).transform(world_SE3_base.inverse())
                middle = base_SE3_lidar.inverse().apply(there.center)
                labels = [
                    {
                        "type": "Car",
                        "track_id": f"{IDS[row] - 1:06d}",
                        "3d_dimensions": {"h": str(SIZE[2]), "w": str(SIZE[1]), "l": str(SIZE[0])},
                        "3d_location": dict(zip("xyz", middle[row].tolist(), strict=True)),
                        "rotation": float(there.yaw[row]),
                    }
                    for row in range(2)
                ]
                labels.append({**labels[0], "type": "TrafficCone", "track_id": "-1"})
                _write_json(folder / f"cooperative/label/{number}.json", labels)
        pair = {"vehicle_frame": f"{frame + 10:06d}", "infrastructure_frame": f"{frame + 500:06d}"}
        lists["cooperative"].append({**pair, "vehicle_sequence": "0003", "infrastructure_sequence": "0009"})
    for name, entries in lists.items():
        _write_json(folder / name / "data_info.json", entries)
    return folder


def write_kitti(folder: Path, pitch_deg: float = PITCH_DEG) -> Path:
    """Write one sequence of agent A, whose camera is under the LiDAR and looks along its x axis."""
    root, world_SE3_base = folder / "training", WORLD_SE3_BASES[0]
    imu = tilted(pitch_deg, 0.5)
    base_SE3_lidar = tilted(pitch_deg, KITTI_LIDAR_M)
    lidar_SE3_camera = SE3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.1, 0.0, -0.1]))
    camera_SE3_lidar = lidar_SE3_camera.inverse()
    rows = {
        "P2:": np.array([[300.0, 0.0, 621.0, 0.0], [0.0, 300.0, 187.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
        "R_rect": np.eye(3),
        "Tr_velo_cam": np.column_stack([camera_SE3_lidar.rotation, camera_SE3_lidar.translation]),
        "Tr_imu_velo": _matrix34(base_SE3_lidar.inverse().compose(imu)),
    }
    text = "".join(f"{name} {' '.join(map(str, each.ravel().tolist()))}\n" for name, each in rows.items())
    _write(root / "calib/0002.txt", text.encode())
    pitch = np.radians(pitch_deg)
    _write(root / "oxts/0002.txt", f"49.0 8.4 110.0 0.0 {pitch} {np.pi / 2} 0 0\n".encode() * FRAMES)
    labels: list[str] = []
    camera_SE3_base = camera_SE3_lidar.compose(base_SE3_lidar.inverse())
    for frame in range(FRAMES):
        points, intensity = cloud(frame, world_SE3_base)
        seen = base_SE3_lidar.inverse().apply(points).astype(np.float32)
        _write(root / f"velodyne/0002/{frame:06d}.bin", np.column_stack([seen, intensity]).astype("<f4").tobytes())
        there = boxes(frame)
        for row in range(2):
            length, width, height = SIZE
            x, y, z = camera_SE3_base.apply(there.center[row])
            turn = -there.yaw[row] - np.pi / 2
            labels.append(
                f"{frame} {IDS[row] - 1} Car 0 0 0 0 0 9 9 {height} {width} {length} {x} {y + height / 2} {z} {turn}"
            )
        labels.append(f"{frame} -1 DontCare -1 -1 -10 0 0 9 9 -1 -1 -1 -1000 -1000 -1000 -10")
    _write(root / "label_02/0002.txt", ("\n".join(labels) + "\n").encode())
    return folder


def _rigid(pose: SE3) -> dict[str, Any]:
    return {"rotation": pose.rotation.tolist(), "translation": pose.translation[:, None].tolist()}


def _matrix34(pose: SE3) -> np.ndarray:
    return np.column_stack([pose.rotation, pose.translation])


def _write_json(path: Path, content: Any) -> None:
    _write(path, json.dumps(content).encode())


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
