"""The records of one scene: an agent's samples, their sensor data, poses and annotations, frame by frame."""

from __future__ import annotations

from typing import Any

from scipy.spatial.transform import Rotation

from coopsim.data.export.export_frame import ExportAgent, ExportFrame
from coopsim.data.export.nuscenes_tables.annotation_records import AnnotationRecords, Records
from coopsim.data.export.nuscenes_tables.nuscenes_names import camera_channel, lidar_channel, sample_token
from coopsim.data.export.record_parts import FIRST_US, token
from coopsim.data.files.float_points import encode_float_points
from coopsim.data.files.pictures import encode_jpeg
from coopsim.geometry.se3 import SE3

_BRIGHTEST = 255.0


class SceneRecords:
    """The scene of one agent in one episode.

    Args:
        scene: its name.
        column: number of the agent.
        frames: of the episode.
        key_every: every how many frames there is a key frame.
        own_points: as of `AnnotationRecords`.
    """

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
