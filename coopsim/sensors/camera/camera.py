"""A camera and its mounting."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.limits import FARTHEST_M, FARTHEST_MOUNT_M, NEAREST_M
from coopsim.support.checks import require_between, require_finite_number
from coopsim.types import CameraCalibration


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera and its mounting on an agent.

    Attributes:
        name: unique in its rig.
        intrinsics: its lens and chip.
        x_m: distance ahead of the agent's middle. This and the next two are in [-100, 100].
        y_m: distance to the left of it.
        above_m: height over the agent's body; negative below its top.
        yaw_rad: to the left.
        pitch_rad: downwards.
        roll_rad: clockwise, seen from behind.
        near_m: depth along the optical axis below which nothing is drawn; at least 0.001.
        far_m: depth beyond which nothing is drawn; at most 10 km.

    Raises:
        InvalidValueError: a number out of its range, or a name that is no word.
    """

    name: str
    intrinsics: Intrinsics = field(default_factory=Intrinsics.from_fov)
    x_m: float = 0.0
    y_m: float = 0.0
    above_m: float = 0.15
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    near_m: float = 0.2
    far_m: float = 300.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise InvalidValueError(f"name of a camera must be a word, as 'front_left', got {self.name!r}")
        if not isinstance(self.intrinsics, Intrinsics):
            raise InvalidValueError(
                f"intrinsics of camera {self.name!r} must be Intrinsics, as Intrinsics.from_fov(320, 180), "
                f"got {self.intrinsics!r}"
            )
        of = f"of camera {self.name!r}"
        for offset in ("x_m", "y_m", "above_m"):
            require_between(-FARTHEST_MOUNT_M, FARTHEST_MOUNT_M, **{f"{offset} {of}": getattr(self, offset)})
        for angle in ("yaw_rad", "pitch_rad", "roll_rad"):
            require_finite_number(**{f"{angle} {of}": getattr(self, angle)})
        require_between(NEAREST_M, FARTHEST_M, **{f"near_m {of}": self.near_m, f"far_m {of}": self.far_m})
        if self.near_m >= self.far_m:
            raise InvalidValueError(f"near_m must be less than far_m {of}, got {self.near_m!r} and {self.far_m!r}")

    def base_SE3_camera(self, body_height_m: float) -> SE3:
        """Return the pose on an agent of this height; camera axes are OpenCV's (x right, y down, z forward)."""
        cos, sin = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        mount = SE3.from_xyz_yaw([self.x_m, self.y_m, body_height_m + self.above_m], self.yaw_rad)
        # Columns: the camera's x, y, z in the axes of a body that looks ahead with x forward, y left, z up.
        pitched = np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
        cos, sin = np.cos(self.roll_rad), np.sin(self.roll_rad)
        rolled = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return mount.compose(SE3(pitched @ rolled, np.zeros(3)))

    def calibration(self, body_height_m: float) -> CameraCalibration:
        """Return what a policy may know of the camera, on an agent of this height."""
        lens = self.intrinsics
        return CameraCalibration(lens.size, lens.matrix, np.array(lens.distortion), self.base_SE3_camera(body_height_m))
