"""Tiny folders of data sets of one car, in the exact layouts of the data sets: the scene of `tiny_recordings`.

The car is agent A, and its LiDAR is over the origin. In Argoverse 2 and nuScenes it has a rear axle behind that, whose
frame tilts by `PITCH_DEG`, far from the origin of the map.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import tiny_recordings as tiny
from pyarrow import feather

from coopsim.geometry.se3 import SE3

FAR = SE3.from_xyz_yaw([1500.0, -700.0, 20.0], 0.7)
"""Pose of agent A's base frame in the map."""

NS = 315_966_253_660_000_000
AV2_LIDAR = SE3.from_xyz_yaw([1.35, 0.0, 1.64], 0.0)
AV2_HEIGHT_M = 1.97
NUSCENES_LIDAR = SE3.from_xyz_yaw([0.94, 0.0, 1.84], -np.pi / 2)
"""Poses of the LiDARs in the cars' frames; nuScenes' looks to the right."""


def quaternion(pose: SE3) -> list[float]:
    """w, x, y, z of a pose that pitches and then turns."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat().tolist()
    return [w, x, y, z]


def base_SE3_ego(ego_SE3_lidar: SE3, height_m: float) -> SE3:
    """The car's frame, tilted so that its LiDAR is at that height over the base frame's origin."""
    turn = tiny.tilted(tiny.PITCH_DEG).rotation
    return SE3(turn, np.array([0.0, 0.0, height_m]) - turn @ ego_SE3_lidar.translation)


def write_kitti_object(folder: Path) -> Path:
    """Write `training` with three frames, from those of KITTI tracking; nothing tells how its LiDAR tilts."""
    made = tiny.write_kitti(folder / "tracking", pitch_deg=0.0) / "training"
    root = folder / "training"
    for name in ("velodyne", "label_2", "calib"):
        (root / name).mkdir(parents=True)
    names = {"R_rect": "R0_rect:", "Tr_velo_cam": "Tr_velo_to_cam:", "Tr_imu_velo": "Tr_imu_to_velo:"}
    calibration = (made / "calib/0002.txt").read_text()
    for old, new in names.items():
        calibration = calibration.replace(old, new)
    lines = [line.split() for line in (made / "label_02/0002.txt").read_text().splitlines()]
    for frame in range(tiny.FRAMES):
        stem = f"{frame + 5:06d}"
        (made / f"velodyne/0002/{frame:06d}.bin").rename(root / f"velodyne/{stem}.bin")
        labels = [" ".join(words[2:]) for words in lines if words[0] == str(frame)]
        labels.append("DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10")
        (root / f"label_2/{stem}.txt").write_text("\n".join(labels) + "\n")
        (root / f"calib/{stem}.txt").write_text(calibration)
    return folder


def write_feather(path: Path, columns: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pa.table(columns), str(path), compression="zstd")


def _pose_columns(poses: list[SE3]) -> dict[str, Any]:
    rows = np.array([[*quaternion(pose), *pose.translation] for pose in poses]).reshape(-1, 7)
    return dict(zip(("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"), rows.T, strict=True))


def write_argoverse2(folder: Path, more: dict[str, Any] | None = None) -> Path:
    """Write a log of the split "val"; `more` has categories by track, beside the parked car (at its place)."""
    log = folder / "val" / "7fab2350-7eaf-3b7e-a39d-6937a4c1bede"
    here = base_SE3_ego(AV2_LIDAR, AV2_HEIGHT_M)
    mounted = {"sensor_name": ["ring_front_center", "up_lidar", "down_lidar"]}
    write_feather(
        log / "calibration/egovehicle_SE3_sensor.feather",
        mounted | _pose_columns([SE3.identity(), AV2_LIDAR, AV2_LIDAR]),
    )
    stamps, placed, annotations = [], [], list[tuple[Any, ...]]()
    for frame in range(tiny.FRAMES):
        stamp = NS + round(frame * tiny.STEP_S * 1e9)
        stamps += [stamp - 5_000_000, stamp]
        placed += [FAR.compose(here)] * 2
        points, intensity = tiny.cloud(frame, SE3.identity())
        seen = here.inverse().apply(points)
        columns = {axis: seen[:, k].astype(np.float16) for k, axis in enumerate("xyz")}
        columns |= {"intensity": np.rint(255 * intensity).astype(np.uint8)}
        columns |= {
            "laser_number": np.zeros(len(points), np.uint8),
            "offset_ns": np.arange(len(points), dtype=np.int32),
        }
        write_feather(log / f"sensors/lidar/{stamp}.feather", columns)
        boxes = tiny.boxes(frame)
        kinds = {"track-7": "REGULAR_VEHICLE", "track-8": "BOX_TRUCK", "track-9": "BOLLARD", **(more or {})}
        for track, kind in kinds.items():
            row = 0 if track == "track-7" else 1
            # Upright in the car's frame, as labels of the data set are.
            center = here.inverse().apply(boxes.center[row])
            pose = SE3.from_xyz_yaw(center, float(boxes.yaw[row]))
            annotations.append((stamp, track, kind, *tiny.SIZE, *quaternion(pose), *center, 12))
    names = ("timestamp_ns", "track_uuid", "category", "length_m", "width_m", "height_m")
    names += ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m", "num_interior_pts")
    write_feather(
        log / "annotations.feather",
        {name: list(each) for name, each in zip(names, zip(*annotations, strict=True), strict=True)},
    )
    write_feather(log / "city_SE3_egovehicle.feather", {"timestamp_ns": stamps} | _pose_columns(placed))
    return folder


def _placed(pose: SE3) -> dict[str, Any]:
    return {"translation": pose.translation.tolist(), "rotation": quaternion(pose)}


def write_nuscenes(folder: Path) -> Path:
    """Write version `v1.0-mini` with one scene, whose key frames are `STEP_S` apart; each has a sweep behind it."""
    tables: dict[str, list[dict[str, Any]]] = {
        "scene": [{"token": "s", "name": "scene-0061", "nbr_samples": tiny.FRAMES, "first_sample_token": "k0"}],
        "sensor": [
            {"token": "top", "channel": "LIDAR_TOP", "modality": "lidar"},
            {"token": "radar", "channel": "RADAR_FRONT", "modality": "radar"},
            {"token": "front", "channel": "CAM_FRONT", "modality": "camera"},
        ],
        "calibrated_sensor": [
            {"token": "c0", "sensor_token": "top", **_placed(NUSCENES_LIDAR), "camera_intrinsic": []},
            {"token": "c1", "sensor_token": "radar", **_placed(NUSCENES_LIDAR), "camera_intrinsic": []},
        ],
        "category": [
            {"token": "car", "name": "vehicle.car"},
            {"token": "bus", "name": "vehicle.bus.rigid"},
            {"token": "cone", "name": "movable_object.trafficcone"},
        ],
        "instance": [
            {"token": "i7", "category_token": "car"},
            {"token": "i8", "category_token": "bus"},
            {"token": "i9", "category_token": "cone"},
        ],
        "sample": [],
        "sample_data": [],
        "sample_annotation": [],
        "ego_pose": [],
    }
    height_m = float(NUSCENES_LIDAR.translation[2])
    here = base_SE3_ego(NUSCENES_LIDAR, height_m)
    lidar_SE3_base = here.compose(NUSCENES_LIDAR).inverse()
    for frame in reversed(range(tiny.FRAMES)):
        time_us, name = 1_532_402_927_647_951 + round(frame * tiny.STEP_S * 1e6), f"samples/LIDAR_TOP/{frame}.pcd.bin"
        tables["sample"].append({"token": f"k{frame}", "timestamp": time_us, "scene_token": "s"})
        tables["ego_pose"].append({"token": f"p{frame}", "timestamp": time_us, **_placed(FAR.compose(here))})
        for number, (sensor, key) in enumerate((("c0", True), ("c1", True), ("c0", False))):
            tables["sample_data"].append(
                {
                    "token": f"d{frame}{number}",
                    "sample_token": f"k{frame}",
                    "ego_pose_token": f"p{frame}",
                    "calibrated_sensor_token": sensor,
                    "timestamp": time_us,
                    "is_key_frame": key,
                    "filename": name if sensor == "c0" and key else "sweeps/other.bin",
                }
            )
        points, intensity = tiny.cloud(frame, SE3.identity())
        rows = np.column_stack([lidar_SE3_base.apply(points), np.rint(255 * intensity), np.zeros(len(points))])
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(rows.astype("<f4").tobytes())
        boxes, length_width_height = tiny.boxes(frame).transform(FAR), tiny.SIZE
        for row, instance in enumerate(("i7", "i8", "i9")):
            pose = SE3.from_xyz_yaw(boxes.center[min(row, 1)], float(boxes.yaw[min(row, 1)]))
            tables["sample_annotation"].append(
                {
                    "token": f"a{frame}{row}",
                    "sample_token": f"k{frame}",
                    "instance_token": instance,
                    **_placed(pose),
                    "size": [length_width_height[k] for k in (1, 0, 2)],
                    "num_lidar_pts": 5,
                }
            )
    (folder / "v1.0-mini").mkdir()
    for name, records in tables.items():
        (folder / "v1.0-mini" / f"{name}.json").write_text(json.dumps(records))
    return folder


def write_arrays(folder: Path, **changed: Any) -> Path:
    """Write frames "queue_07" to "queue_09"; `changed` are arrays of all, or None for those to leave out."""
    folder.mkdir(parents=True, exist_ok=True)
    for frame in range(tiny.FRAMES):
        points, intensity = tiny.cloud(frame, SE3.identity())
        arrays: dict[str, Any] = {
            "points": np.column_stack([points, intensity, np.zeros(len(points))]).astype(np.float32),
            "boxes": np.vstack([tiny.boxes(frame).array, [[5.0, 5.0, 0.5, 1.0, 1.0, 1.0, 0.0]]]),
            "names": np.array(["regular_vehicle", "Truck", "bollard"]),
            "ids": np.array([0, 1, 2]),
            "time_s": np.float64(100.0 + frame * tiny.STEP_S),
            "pose": np.eye(4),
        }
        arrays = {name: value for name, value in (arrays | changed).items() if value is not None}
        np.savez(folder / f"queue_{frame + 7:02d}.npz", **arrays)
    return folder


def write_clouds_with_labels(folder: Path, ending: str = ".npy") -> Path:
    """Write `points` and `labels`, in the frame of a LiDAR 1.8 m above the ground."""
    for name in ("points", "labels"):
        (folder / name).mkdir(parents=True)
    for frame in range(tiny.FRAMES):
        points, intensity = tiny.cloud(frame, SE3.identity())
        rows = np.column_stack([points - np.float32([0, 0, 1.8]), intensity]).astype("<f4")
        path = folder / "points" / f"{frame:06d}{ending}"
        if ending == ".npy":
            np.save(path, rows)
        else:
            path.write_bytes(rows.tobytes())
        lines = [
            " ".join([*(str(value) for value in (box - [0, 0, 1.8, 0, 0, 0, 0]).tolist()), kind])
            for box, kind in zip(tiny.boxes(frame).array, ("Car", "Truck"), strict=True)
        ]
        (folder / "labels" / f"{frame:06d}.txt").write_text("\n".join(lines))
    return folder
