"""A camera's lens and chip: between directions and pixels."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.distortion import NO_DISTORTION, Coefficients, distort, undistort
from coopsim.sensors.limits import FARTHEST_AXIS_PX, FOCAL_PX
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_between, require_count, require_number

MOST_PIXELS = 8192
"""Most pixels along either side; a larger number is a slip that would fill the memory."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera with lens distortion, as OpenCV describes it.

    Pixel (column u, row v) is centred on the point (u, v): the picture reaches from -0.5 to width - 0.5. Axes are
    x right, y down, z forward.

    Attributes:
        width: pixels.
        height: pixels.
        fx_px: focal length along x, in [0.001, 1e6].
        fy_px: focal length along y, the same.
        cx_px: column of the optical axis, in [-1e6, 1e6].
        cy_px: row of the optical axis, the same.
        distortion: k1, k2, p1, p2, k3, see `coopsim.sensors.camera.distortion`.

    Raises:
        InvalidValueError: a number out of its range, or a distortion that folds the picture over.
    """

    width: int
    height: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: Coefficients = field(default=NO_DISTORTION)

    def __post_init__(self) -> None:
        require_count(1, MOST_PIXELS, width=self.width, height=self.height)
        require_between(*FOCAL_PX, fx_px=self.fx_px, fy_px=self.fy_px)
        require_between(-FARTHEST_AXIS_PX, FARTHEST_AXIS_PX, cx_px=self.cx_px, cy_px=self.cy_px)
        coefficients = frozen(self.distortion, (5,), np.float64, "distortion (k1, k2, p1, p2, k3)")
        require_finite(coefficients, "distortion (k1, k2, p1, p2, k3)")
        object.__setattr__(self, "distortion", tuple(coefficients.tolist()))
        if self.distorts:
            self.rays  # noqa: B018  (refuses a lens that folds the picture over)

    @classmethod
    def from_fov(
        cls,
        width: int = 320,
        height: int = 180,
        horizontal_fov_rad: float = np.radians(100.0),
        distortion: Coefficients = NO_DISTORTION,
    ) -> Self:
        """Make intrinsics with square pixels, a central axis and an opening angle in (0, pi), without distortion."""
        require_count(1, MOST_PIXELS, width=width, height=height)
        require_number("in (0, pi)", lambda fov: 0 < fov < np.pi, horizontal_fov_rad=horizontal_fov_rad)
        focal_px = float(width / 2 / np.tan(horizontal_fov_rad / 2))
        return cls(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, distortion)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, the order of an array's shape."""
        return (self.height, self.width)

    @property
    def matrix(self) -> Floats:
        """The camera matrix K, (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @property
    def distorts(self) -> bool:
        """Whether the lens differs from a pinhole."""
        return any(self.distortion)

    @cached_property
    def rays(self) -> Floats:
        """Directions (H * W, 3) of the pixels' middles, row by row, in camera axes, 1 along the optical axis."""
        columns = (np.arange(self.width) - self.cx_px) / self.fx_px
        rows = (np.arange(self.height) - self.cy_px) / self.fy_px
        seen = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        if self.distorts:
            seen = undistort(seen, self.distortion)
        rays: Floats = np.column_stack([seen, np.ones(len(seen))])
        rays.flags.writeable = False
        return rays

    @cached_property
    def stretch(self) -> NDArray[np.float32]:
        """Distance along each pixel's ray for a depth of 1, (H, W)."""
        stretch: NDArray[np.float32] = np.linalg.norm(self.rays, axis=1).astype(np.float32)
        return stretch.reshape(self.size)

    @cached_property
    def unit_rays(self) -> Floats:
        """The rays normalized to length 1, (H * W, 3)."""
        rays: Floats = self.rays / np.linalg.norm(self.rays, axis=1, keepdims=True)
        return rays

    def project(self, points_m: Floats) -> Floats:
        """Project points (N, 3) m in camera axes, in front of the camera, to columns and rows (N, 2) in pixels."""
        seen = distort(points_m[:, :2] / points_m[:, 2:], self.distortion)
        return seen * [self.fx_px, self.fy_px] + [self.cx_px, self.cy_px]
