"""Sensor data of an agent in one frame: LiDAR sweeps, camera images, calibrations, pose and odometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import Shape, freeze, require_finite
from coopsim.support.checks import require_count
from coopsim.types.units import Ints

OBSERVED_MODES = ("rgb", "depth")
"""Modes of images that a camera with a depth sensor measures."""

TRUTH_MODES = ("instance", "semantic")
"""Modes of images that no camera measures."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Points of one revolution of one LiDAR, in the agent's base frame.

    Attributes:
        points: (N, 3) m, float32.
        intensity: (N,) in [0, 1], float32.
        beam: (N,) row of the beam table, int64.
        instance: (N,) id of the actor that was hit, 0 for the static scene and -1 for clutter. For training and tests:
            None in all inputs of a policy or a `Detector`.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    beam: Ints
    instance: Ints | None = None

    def __post_init__(self) -> None:
        freeze(self, points=((None, 3), np.float32))
        one = (len(self.points),)
        freeze(self, intensity=(one, np.float32), beam=(one, np.int64), instance=(one, np.int64))

    @classmethod
    def empty(cls) -> Sweep:
        """Return a sweep without points."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.points)

    def without_truth(self) -> Sweep:
        """Return the sweep without instance ids."""
        return Sweep(self.points, self.intensity, self.beam)


@dataclass(frozen=True, slots=True, eq=False)
class LidarMounting:
    """A LiDAR's place on an agent and the rays that it casts.

    Attributes:
        base_SE3_lidar: pose of the LiDAR in the agent's base frame: rays start at its translation.
        max_range_m: farthest return.
        columns: firings per revolution, at equal steps of azimuth.
        elevation_rad: (B,) elevation of each beam in the LiDAR's own frame, positive upwards.
    """

    base_SE3_lidar: SE3
    max_range_m: float
    columns: int
    elevation_rad: Floats

    def __post_init__(self) -> None:
        freeze(self, elevation_rad=((None,), np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """The image of one camera, in the modes that were asked for; the others are None.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32, m along the optical axis; 0 where nothing was hit.
        instance: (H, W) int64, the actor's id; 0 where there is none. Truth: not in observations.
        semantic: (H, W) uint8, the actor's `ObjectClass`; 255 where there is none. Truth: not in observations.
    """

    rgb: NDArray[np.uint8] | None = None
    depth: NDArray[np.float32] | None = None
    instance: Ints | None = None
    semantic: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        tails: dict[str, tuple[int, ...]] = {"rgb": (3,), "depth": (), "instance": (), "semantic": ()}
        dtypes = {"rgb": np.uint8, "depth": np.float32, "instance": np.int64, "semantic": np.uint8}
        size: Shape = (None, None)
        for name, tail in tails.items():
            freeze(self, **{name: ((*size, *tail), dtypes[name])})
            pixels = getattr(self, name)
            size = size if pixels is None else pixels.shape[:2]

    @classmethod
    def blank(cls, size: tuple[int, int], modes: Sequence[str]) -> CameraImage:
        """Return a black image of this height and width, with depth 0, in those of the observed modes."""
        rgb = np.zeros((*size, 3), np.uint8) if "rgb" in modes else None
        return cls(rgb, np.zeros(size, np.float32) if "depth" in modes else None)

    def without_truth(self) -> CameraImage:
        """Return the image without the modes that are truth."""
        return CameraImage(self.rgb, self.depth)


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """A camera's intrinsics and its place on an agent.

    Pixel (column u, row v) is centred on the point (u, v). Camera axes are OpenCV's: x right, y down, z forward.

    Attributes:
        size: height and width of its images, pixels.
        matrix: (3, 3), OpenCV's K.
        distortion: (5,) k1, k2, p1, p2, k3 (Brown-Conrady, OpenCV's order); zeros for a pinhole.
        base_SE3_camera: pose of the camera in the agent's base frame.

    Raises:
        InvalidValueError: a number is not finite, the size is not two integers >= 1, or the matrix is not of the form
            [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy.
    """

    size: tuple[int, int]
    matrix: Floats
    distortion: Floats
    base_SE3_camera: SE3

    def __post_init__(self) -> None:
        freeze(self, matrix=((3, 3), np.float64), distortion=((5,), np.float64))
        require_count(1, height=self.size[0], width=self.size[1])
        pose = self.base_SE3_camera
        for name in ("matrix", "distortion"):
            require_finite(getattr(self, name), name)
        for name in ("rotation", "translation"):
            require_finite(getattr(pose, name), f"{name} of base_SE3_camera")
        fx, fy, cx, cy = self.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        if not (fx > 0 and fy > 0 and (self.matrix == [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]).all()):
            raise InvalidValueError(
                "matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy, "
                f"got {self.matrix.tolist()}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """An agent's estimate of its own pose, `world_SE3_base`: gravity-aligned and GNSS-like (noisy, no drift).

    Attributes:
        xyz_yaw: (4,): x, y, z m and heading rad, in the world frame.
        covariance: (3, 3) of x, y and heading as the agent states it, which need not be right; None: not stated.
    """

    xyz_yaw: Floats
    covariance: Floats | None = None

    def __post_init__(self) -> None:
        freeze(self, xyz_yaw=((4,), np.float64), covariance=((3, 3), np.float64))

    @property
    def world_SE3_base(self) -> SE3:
        """The estimate as a transform."""
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """An agent's estimate of its motion since its last frame, `previous_SE3_current` (small drift).

    Attributes:
        xyz_yaw: (4,): x, y, z m and heading rad, in the base frame of the last observation.
    """

    xyz_yaw: Floats

    def __post_init__(self) -> None:
        freeze(self, xyz_yaw=((4,), np.float64))

    @property
    def previous_SE3_current(self) -> SE3:
        """The motion as a transform."""
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


@dataclass(frozen=True, slots=True, eq=False)
class SensorView:
    """Sensor data of one agent in one frame, input of a detector; never truth, never instance ids.

    Attributes:
        agent: the agent's name.
        time_ns: now, since the episode's start.
        odometry: motion since the last frame.
        sweeps: sweep of each LiDAR, by name, in the base frame; `instance` is None.
        images: image of each camera, by name; `instance` and `semantic` are None.
        cameras: calibration of each camera, by name.
        lidars: mounting of each LiDAR, by name.
        pose: the agent's estimate of its pose, by whose heading an encoder may turn what it sees into the world's axes;
            None: not known.
    """

    agent: str
    time_ns: int
    odometry: Odometry
    sweeps: Mapping[str, Sweep] = field(default_factory=dict)
    images: Mapping[str, CameraImage] = field(default_factory=dict)
    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict)
    lidars: Mapping[str, LidarMounting] = field(default_factory=dict)
    pose: PoseEstimate | None = None


def stack_xyz_yaw(pose: SE3) -> Floats:
    """Return a gravity-aligned transform as (4,): x, y, z m and heading rad."""
    row = np.empty(4)
    row[:3], row[3] = pose.translation, pose.yaw
    return row
