"""Pictures that are black but for light on the ground, for tests of networks on pictures without a renderer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import CameraImage, Odometry, PoseEstimate, SensorView

CAMERAS = {
    f"camera_{k}": Camera(
        f"camera_{k}", Intrinsics.from_fov(160, 96, np.radians(100.0)), yaw_rad=k * np.pi / 2, pitch_rad=np.radians(20)
    )
    for k in range(4)
}
"""Four small cameras of a mast, all around."""


def lit_view(
    *lights_m: tuple[float, float], yaw_rad: float = 0.0, cameras: Sequence[str] = tuple(CAMERAS), modes: str = "rgb"
) -> SensorView:
    """What cameras 6 m above the ground see of lights of 3 m there, at places (x, y) m of the agent's compass frame."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    calibrations = {name: CAMERAS[name].calibration(6.0) for name in cameras}
    images = {}
    for name, calibration in calibrations.items():
        rgb = np.zeros((*calibration.size, 3), np.uint8)
        rows, columns = np.indices(calibration.size)
        pixels = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(calibration.matrix).T
        rays = pixels @ calibration.base_SE3_camera.rotation.T
        start = calibration.base_SE3_camera.translation
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = start[:2] - start[2] * rays[..., :2] / rays[..., 2:]
        ground[rays[..., 2] >= -1e-3] = np.inf
        for x_m, y_m in lights_m:
            place = [cos * x_m + sin * y_m, -sin * x_m + cos * y_m]
            rgb[np.linalg.norm(ground - place, axis=-1) < 3.0] = 255
        depth = np.zeros(calibration.size, np.float32) if modes == "depth" else None
        images[name] = CameraImage(None if modes == "depth" else rgb, depth)
    pose = PoseEstimate(np.array([0.0, 0.0, 0.0, yaw_rad]))
    return SensorView("rsu_0", 0, Odometry(np.zeros(4)), images=images, cameras=calibrations, pose=pose)
