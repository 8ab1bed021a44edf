"""The camera frame in which KITTI labels are, and the texts of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.data.export.export_frame import ExportAgent, LidarScan
from coopsim.data.kitti import AXES_SE3_CAMERA
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import CameraCalibration

_SIZE, _FOCAL_PX, _MIDDLE_PX = (375, 1242), 721.5377, (609.5593, 172.854)
_UPRIGHT = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LabelFrame:
    """Where an agent's labels are: at its camera, which looks level along the camera's heading.

    KITTI's camera hardly nods. That of a mast does: its labels are in the frame of a level camera at the same place,
    and the projection matrix turns it down.

    Attributes:
        camera: the calibration of the pictures; without a camera, that of KITTI's, on the LiDAR.
        base_SE3_level: the frame with our axes (x forward, y left, z up), in the agent's base frame.
    """

    camera: CameraCalibration
    base_SE3_level: SE3

    @classmethod
    def of(cls, scan: LidarScan, camera: CameraCalibration | None) -> LabelFrame:
        """Return the frame of an agent's LiDAR and camera."""
        if camera is None:
            mounting = scan.mounting.base_SE3_lidar
            level = SE3.from_xyz_yaw(mounting.translation, mounting.yaw)
            matrix = np.array([[_FOCAL_PX, 0.0, _MIDDLE_PX[0]], [0.0, _FOCAL_PX, _MIDDLE_PX[1]], [0.0, 0.0, 1.0]])
            camera = CameraCalibration(_SIZE, matrix, np.zeros(5), level.compose(AXES_SE3_CAMERA))
        ahead = camera.base_SE3_camera.rotation[:, 2]
        yaw = float(np.arctan2(ahead[1], ahead[0])) if np.hypot(ahead[0], ahead[1]) > _UPRIGHT else 0.0
        return cls(camera, SE3.from_xyz_yaw(camera.base_SE3_camera.translation, yaw))

    @property
    def base_SE3_rect(self) -> SE3:
        """The frame with the axes of a camera: KITTI's rectified camera coordinates."""
        return self.base_SE3_level.compose(AXES_SE3_CAMERA)

    @property
    def projection(self) -> Floats:
        """(3, 4) matrix P2 from the rectified camera's coordinates to pixels."""
        camera_SE3_rect = self.camera.base_SE3_camera.inverse().compose(self.base_SE3_rect)
        matrix: Floats = self.camera.matrix @ np.column_stack([camera_SE3_rect.rotation, np.zeros(3)])
        return matrix


def calibration_text(frame: LabelFrame, scan: LidarScan) -> str:
    """Return the lines of a sequence's file in `calib`. All four projections are that of the one camera."""
    rect_SE3_lidar = frame.base_SE3_rect.inverse().compose(scan.mounting.base_SE3_lidar)
    lidar_SE3_base = scan.mounting.base_SE3_lidar.inverse()
    rows = {
        **{f"P{number}:": frame.projection for number in range(4)},
        "R_rect": np.eye(3),
        "Tr_velo_cam": _matrix(rect_SE3_lidar),
        "Tr_imu_velo": _matrix(lidar_SE3_base),
    }
    return "".join(f"{name} {' '.join(f'{value:.12e}' for value in row.ravel())}\n" for name, row in rows.items())


def front_camera(agent: ExportAgent, name: str | None) -> str | None:
    """Return the name of an agent's camera: the given one, else the one that looks most ahead; None without any."""
    if name is not None or not agent.cameras:
        return name
    return max(agent.cameras, key=lambda each: agent.cameras[each].calibration.base_SE3_camera.rotation[0, 2])


def _matrix(transform: SE3) -> Floats:
    return np.column_stack([transform.rotation, transform.translation])
