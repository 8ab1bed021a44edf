"""Small cameras at odd places, for tests of what looks through them."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import CameraCalibration

BENT = (-0.15, 0.03, 0.002, -0.003, 0.0)
"""Coefficients of a lens that distorts."""

PLAIN = Intrinsics.from_fov(48, 32)
OFF_AXIS = Intrinsics(48, 32, 25.0, 30.0, 20.0, 18.0)
ODD = Intrinsics.from_fov(44, 27)
BENT_LENS = Intrinsics(48, 32, 25.0, 25.0, 22.0, 17.0, BENT)

AHEAD = Camera("ahead", PLAIN)
SIDEWAYS = Camera("sideways", OFF_AXIS, x_m=0.5, y_m=-0.3, yaw_rad=2.0, pitch_rad=0.4)
ROLLED = Camera("rolled", PLAIN, yaw_rad=-1.0, pitch_rad=0.1, roll_rad=0.6)
HANGING = Camera("hanging", PLAIN, yaw_rad=1.0, pitch_rad=0.3, roll_rad=3.0)
BENT_CAMERA = Camera("bent", BENT_LENS, yaw_rad=0.3, pitch_rad=0.2, roll_rad=-0.2)
PARTIAL = Camera("partial", ODD, yaw_rad=-2.5, pitch_rad=0.3)

CAMERAS = (AHEAD, SIDEWAYS, ROLLED, HANGING, BENT_CAMERA, PARTIAL)
"""A pinhole ahead, a lens off its axis, one rolled, one upside down, a lens that distorts, and parts of cells."""


def in_mirror(calibration: CameraCalibration) -> CameraCalibration:
    """Return the camera that takes pictures with left and right exchanged of a world in which y is -y."""
    pose, matrix, distortion = calibration.base_SE3_camera, calibration.matrix.copy(), calibration.distortion.copy()
    matrix[0, 2] = calibration.size[1] - 1 - matrix[0, 2]
    distortion[3] *= -1
    turned = np.diag([1.0, -1.0, 1.0]) @ pose.rotation @ np.diag([-1.0, 1.0, 1.0])
    return CameraCalibration(calibration.size, matrix, distortion, SE3(turned, pose.translation * [1.0, -1.0, 1.0]))
