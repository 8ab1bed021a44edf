"""Records of nuScenes' tables: names of classes, and the samples and annotations of one scene, frame by frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from coopsim.data.export.export_frame import ExportAgent, ExportFrame
from coopsim.data.export.record_parts import FIRST_US, token
from coopsim.data.export.seen_share import FREE_SHARE, seen_shares
from coopsim.data.files.pcd import encode_float_points
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.pictures import encode_jpeg
from coopsim.types import ObjectClass

VERSION, SPLIT = "v1.0-coopsim", "all"
"""Folder of the tables, and the name of the split with all scenes in its `splits.json`."""

CATEGORIES = {
    ObjectClass.CAR: "vehicle.car",
    ObjectClass.VAN: "vehicle.car",
    ObjectClass.TRUCK: "vehicle.truck",
    ObjectClass.BUS: "vehicle.bus.rigid",
    ObjectClass.MOTORCYCLE: "vehicle.motorcycle",
    ObjectClass.BICYCLE: "vehicle.bicycle",
    ObjectClass.SCOOTER: "human.pedestrian.personal_mobility",
    ObjectClass.PEDESTRIAN: "human.pedestrian.adult",
    ObjectClass.CHILD: "human.pedestrian.child",
}
"""nuScenes' category of each class: it counts vans as cars, and does not evaluate riders of scooters."""

TRACKED = {
    ObjectClass.CAR: "car",
    ObjectClass.VAN: "car",
    ObjectClass.TRUCK: "truck",
    ObjectClass.BUS: "bus",
    ObjectClass.MOTORCYCLE: "motorcycle",
    ObjectClass.BICYCLE: "bicycle",
    ObjectClass.PEDESTRIAN: "pedestrian",
    ObjectClass.CHILD: "pedestrian",
}
"""Names in the detection and tracking tasks; other classes are not in them."""

RANGE_M = {name: 40.0 if name in ("motorcycle", "bicycle", "pedestrian") else 50.0 for name in TRACKED.values()}
"""Distance from the ego vehicle below which a class is scored."""

_ATTRIBUTES = ("vehicle.moving", "vehicle.stopped", "cycle.with_rider", "pedestrian.moving", "pedestrian.standing")

_VISIBILITY = {"1": (0, 40), "2": (40, 60), "3": (60, 80), "4": (80, 100)}

MOVING_M_S = 0.2
"""Speed from which an object counts as moving."""


def fixed_tables() -> dict[str, list[dict[str, Any]]]:
    """Return the records of category, attribute and visibility."""
    return {
        "category": [
            {"token": token("category", name), "name": name, "description": ""} for name in _distinct(CATEGORIES)
        ],
        "attribute": [{"token": token("attribute", name), "name": name, "description": ""} for name in _ATTRIBUTES],
        "visibility": [
            {"token": name, "level": f"v{low}-{high}", "description": f"{low} to {high} % of the object are visible"}
            for name, (low, high) in _VISIBILITY.items()
        ],
    }


def visibility_token(share: float) -> str:
    """Return the level of visibility of a visible share in [0, 1]."""
    return next((name for name, (_, high) in _VISIBILITY.items() if 100 * share < high), "4")


def attribute_name(label: int, speed_m_s: float) -> str:
    """Return the attribute of an object of a class; empty for the rider of a scooter."""
    category, moving = CATEGORIES[ObjectClass(label)], speed_m_s >= MOVING_M_S
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.with_rider"
    if category == "human.pedestrian.personal_mobility":
        return ""
    if category.startswith("vehicle"):
        return "vehicle.moving" if moving else "vehicle.stopped"
    return "pedestrian.moving" if moving else "pedestrian.standing"


def attribute_tokens(label: int, speed_m_s: float) -> list[str]:
    """Return the tokens of an object's attribute: one, or none for the rider of a scooter."""
    name = attribute_name(label, speed_m_s)
    return [token("attribute", name)] if name else []


def camera_channel(name: str) -> str:
    """Return the channel of a camera, as CAM_BACK_LEFT of "rear_left"."""
    return f"CAM_{name.upper().replace('REAR', 'BACK')}"


def lidar_channel(name: str, position: int) -> str:
    """Return the channel of an agent's LiDAR: the first is LIDAR_TOP, which the official tools look for."""
    return "LIDAR_TOP" if position == 0 else f"LIDAR_{name.upper()}"


def scene_name(episode: str, agent: str) -> str:
    """Return the name of the scene of an agent, as "crossing_0007-cav_0"."""
    return f"{episode}-{agent}"


def sample_token(scene: str, index: int) -> str:
    """Return the token of a scene's sample, by the frame's number in the episode."""
    return token(scene, "sample", index)


def _distinct(names: dict[ObjectClass, str]) -> list[str]:
    return list(dict.fromkeys(names.values()))


Records = dict[str, list[dict[str, Any]]]


class AnnotationRecords:
    """The annotations of one scene, linked by instance.

    An object is annotated in every key frame in which it exists, wherever it is. If it ends and a later one has its
    number, that is another instance.
    """

    def __init__(self, scene: str, column: int, *, own_points: bool) -> None:
        self._scene, self._column, self._own_points = scene, column, own_points
        self._waiting: dict[int, dict[str, Any]] = {}
        self._instances: dict[int, dict[str, Any]] = {}

    def add(self, frame: ExportFrame) -> Records:
        """Take a key frame. Return the records that are complete by it."""
        fresh = self._annotations(frame)
        for number, record in fresh.items():
            last = self._waiting.get(number)
            if last is not None:
                last["next"], record["prev"] = record["token"], last["token"]
            instance = self._instances.setdefault(
                number,
                {
                    "token": token(self._scene, "instance", number, frame.index),
                    "category_token": token("category", CATEGORIES[ObjectClass(record["label"])]),
                    "nbr_annotations": 0,
                    "first_annotation_token": record["token"],
                    "last_annotation_token": "",
                },
            )
            del record["label"]
            record["instance_token"] = instance["token"]
            instance["nbr_annotations"] += 1
            instance["last_annotation_token"] = record["token"]
        ended = [self._instances.pop(number) for number in [*self._instances] if number not in fresh]
        complete = list(self._waiting.values())
        self._waiting = fresh
        return {"sample_annotation": complete, "instance": ended}

    def end(self) -> Records:
        """Return the records that were waiting for another key frame."""
        return {"sample_annotation": list(self._waiting.values()), "instance": list(self._instances.values())}

    def _annotations(self, frame: ExportFrame) -> dict[int, dict[str, Any]]:
        objects = frame.objects
        own_returns = frame.returns[:, self._column]
        returns = own_returns if self._own_points else frame.returns.sum(axis=1)
        visible = np.minimum(seen_shares(frame, self._column) / FREE_SHARE, 1.0)
        speed = np.linalg.norm(frame.velocity, axis=1)
        places, sizes, turns = (
            objects.boxes.center.round(6),
            objects.boxes.size[:, [1, 0, 2]],
            quaternions(objects.boxes.yaw),
        )
        found: dict[int, dict[str, Any]] = {}
        for row, number in enumerate(objects.id.tolist()):
            if number == frame.agents[self._column].body.actor_id:
                continue
            found[number] = {
                "token": token(self._scene, "annotation", frame.index, number),
                "sample_token": sample_token(self._scene, frame.index),
                "instance_token": "",
                "visibility_token": visibility_token(float(visible[row])),
                "attribute_tokens": attribute_tokens(int(objects.label[row]), float(speed[row])),
                "translation": places[row].tolist(),
                "size": sizes[row].tolist(),
                "rotation": turns[row].tolist(),
                "prev": "",
                "next": "",
                "num_lidar_pts": int(returns[row]),
                "num_radar_pts": 0,
                "num_own_lidar_pts": int(own_returns[row]),
                "label": int(objects.label[row]),
            }
        return found


def quaternions(yaw_rad: Floats) -> Floats:
    """Return w, x, y, z (N, 4) of turns (N,) about z."""
    half, zero = yaw_rad / 2, np.zeros(len(yaw_rad))
    turns: Floats = np.column_stack([np.cos(half), zero, zero, np.sin(half)]).round(9)
    return turns


_BRIGHTEST = 255.0


class SceneRecords:
    """The scene of one agent in one episode."""

    def __init__(self, scene: str, column: int, frames: int, key_every: int, *, own_points: bool) -> None:
        self._scene, self._column, self._frames, self._key_every = scene, column, frames, key_every
        self._annotations = AnnotationRecords(scene, column, own_points=own_points)

    def add(self, frame: ExportFrame) -> tuple[Records, dict[str, bytes]]:
        """Return the records of a frame that are complete, and its files by path in the export's folder."""
        agent = frame.agents[self._column]
        is_key = frame.index % self._key_every == 0
        records: Records = self._annotations.add(frame) if is_key else {}
        if frame.index == 0:
            records |= {"scene": [self._scene_record(frame, agent)], "log": [self._log_record(agent)]}
            records["calibrated_sensor"] = self._calibrations(agent)
        stamp = FIRST_US + frame.time_ns // 1000
        if is_key:
            records["sample"] = [
                {
                    "token": sample_token(self._scene, frame.index),
                    "timestamp": stamp,
                    "prev": self._sample(frame.index - self._key_every),
                    "next": self._sample(frame.index + self._key_every),
                    "scene_token": token(self._scene, "scene"),
                }
            ]
        pose = token(self._scene, "pose", frame.index)
        records["ego_pose"] = [{"token": pose, "timestamp": stamp, **_placed(agent.world_SE3_base)}]
        records["sample_data"], files = [], {}
        for channel, content, shape in _sensor_data(agent):
            suffix = "jpg" if shape else "pcd.bin"
            name = f"{'samples' if is_key else 'sweeps'}/{channel}/{self._scene}__{channel}__{stamp}.{suffix}"
            files[name] = content
            records["sample_data"].append(
                {
                    "token": self._datum(channel, frame.index),
                    "sample_token": self._sample(frame.index - frame.index % self._key_every),
                    "ego_pose_token": pose,
                    "calibrated_sensor_token": token(self._scene, "calibration", channel),
                    "timestamp": stamp,
                    "fileformat": "jpg" if shape else "pcd",
                    "is_key_frame": is_key,
                    "height": shape[0] if shape else 0,
                    "width": shape[1] if shape else 0,
                    "filename": name,
                    "prev": self._datum(channel, frame.index - 1),
                    "next": self._datum(channel, frame.index + 1),
                }
            )
        return records, files

    def end(self) -> Records:
        """Return the records that were waiting for another key frame."""
        return self._annotations.end()

    def _scene_record(self, frame: ExportFrame, agent: ExportAgent) -> dict[str, Any]:
        last = (self._frames - 1) // self._key_every
        return {
            "token": token(self._scene, "scene"),
            "log_token": token(self._scene, "log"),
            "nbr_samples": last + 1,
            "first_sample_token": self._sample(0),
            "last_sample_token": self._sample(last * self._key_every),
            "name": self._scene,
            "description": f"seed {frame.seed}, seen by {agent.name}",
        }

    def _log_record(self, agent: ExportAgent) -> dict[str, Any]:
        return {
            "token": token(self._scene, "log"),
            "logfile": self._scene,
            "vehicle": agent.name,
            "date_captured": "2001-09-09",  # the day of the first time stamp
            "location": self._scene.rpartition("_")[0] or self._scene,
        }

    def _calibrations(self, agent: ExportAgent) -> list[dict[str, Any]]:
        mounted: list[tuple[str, SE3, list[list[float]]]] = [
            (lidar_channel(name, position), scan.mounting.base_SE3_lidar, [])
            for position, (name, scan) in enumerate(agent.lidars.items())
        ]
        for name, shot in agent.cameras.items():
            lens = shot.calibration
            mounted.append((camera_channel(name), lens.base_SE3_camera, lens.matrix.tolist()))
        return [
            {
                "token": token(self._scene, "calibration", channel),
                "sensor_token": token("sensor", channel),
                **_placed(place),
                "camera_intrinsic": matrix,
            }
            for channel, place, matrix in mounted
        ]

    def _sample(self, index: int) -> str:
        return sample_token(self._scene, index) if 0 <= index < self._frames else ""

    def _datum(self, channel: str, index: int) -> str:
        return token(self._scene, channel, index) if 0 <= index < self._frames else ""


def _sensor_data(agent: ExportAgent) -> list[tuple[str, bytes, tuple[int, int] | None]]:
    """Return channel, content and (for pictures) height and width of each sensor."""
    found: list[tuple[str, bytes, tuple[int, int] | None]] = []
    for position, (name, scan) in enumerate(agent.lidars.items()):
        content = encode_float_points(scan.points, scan.intensity * _BRIGHTEST, scan.beam)
        found.append((lidar_channel(name, position), content, None))
    for name, shot in agent.cameras.items():
        if shot.image.rgb is not None:
            found.append((camera_channel(name), encode_jpeg(shot.image.rgb), shot.calibration.size))
    return found


def _placed(pose: SE3) -> dict[str, list[float]]:
    """Return a transform as nuScenes writes it, the quaternion as w, x, y, z with w >= 0."""
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat(canonical=True).round(12).tolist()
    return {"translation": pose.translation.round(6).tolist(), "rotation": [w, x, y, z]}
