"""A camera's lens and chip: between directions and pixels, with OpenCV's Brown-Conrady distortion.

A point (x, y) of the normalised image plane (z = 1), at r^2 = x^2 + y^2, is seen at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

Brown, "Decentering Distortion of Lenses", Photogrammetric Engineering 1966; OpenCV, camera calibration.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors import FARTHEST_AXIS_PX, FOCAL_PX
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_between, require_count, require_number

Coefficients = tuple[float, float, float, float, float]
"""k1, k2, p1, p2, k3: radial, radial, tangential, tangential, radial."""

NO_DISTORTION: Coefficients = (0.0, 0.0, 0.0, 0.0, 0.0)

_STEPS, _TOLERANCE = 50, 1e-9


def distort(points: Floats, coefficients: Coefficients) -> Floats:
    """Return the distorted positions (N, 2) of points (N, 2) of the normalised image plane."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = points.T
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
        ]
    )


def undistort(points: Floats, coefficients: Coefficients) -> Floats:
    """Return the points (N, 2) of the normalised image plane that distort to `points` (N, 2), by Newton's method.

    Raises where the distortion is not one to one within these points.
    """
    seen: Floats = np.asarray(points, dtype=np.float64)
    guess = seen.copy()
    with np.errstate(all="ignore"):  # divergence is detected below
        for _ in range(_STEPS):
            error = distort(guess, coefficients) - seen
            if np.abs(error).max(initial=0.0) <= _TOLERANCE:
                break
            a, b, d = _jacobian(guess, coefficients)
            step = np.column_stack([d * error[:, 0] - b * error[:, 1], a * error[:, 1] - b * error[:, 0]])
            guess -= step / (a * d - b**2)[:, None]
        a, b, d = _jacobian(guess, coefficients)
        left = np.abs(distort(guess, coefficients) - seen).max(initial=0.0)
        # A Jacobian that is not positive definite is beyond the fold.
        if not (left <= 1e3 * _TOLERANCE and (a * d - b**2 > 0).all() and (a + d > 0).all()):
            raise InvalidValueError(
                "distortion must be one to one over the whole picture, but "
                f"(k1, k2, p1, p2, k3) = {coefficients} fold it over: take smaller coefficients or a smaller picture"
            )
    return guess


def _jacobian(points: Floats, coefficients: Coefficients) -> tuple[Floats, Floats, Floats]:
    """Return dx'/dx, dx'/dy = dy'/dx, and dy'/dy, (N,) each."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = points.T
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    return (
        radial + slope * x**2 + 2 * p1 * y + 6 * p2 * x,
        slope * x * y + 2 * p1 * x + 2 * p2 * y,
        radial + slope * y**2 + 6 * p1 * y + 2 * p2 * x,
    )


MOST_PIXELS = 8192
"""Most pixels along either side; a larger number is a slip that would fill the memory."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera with lens distortion, as OpenCV describes it.

    Pixel (column u, row v) is centred on the point (u, v): the image reaches from -0.5 to width - 0.5. Axes are
    x right, y down, z forward.

    Attributes:
        width: pixels.
        height: pixels.
        fx_px: focal length along x, in [0.001, 1e6].
        fy_px: focal length along y, the same.
        cx_px: column of the optical axis, in [-1e6, 1e6].
        cy_px: row of the optical axis, the same.
        distortion: k1, k2, p1, p2, k3, see this module's docstring.

    Raises:
        InvalidValueError: a number out of its range, or a distortion that folds the image over.
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
            self.rays  # noqa: B018  (refuses a lens that folds the image over)

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
        """Flag of a lens that differs from a pinhole."""
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


Pixels = NDArray[np.float32]

_FINER = 2
"""Pixels of the pinhole's image for each pixel of the lens's, along either axis."""


class LensLookup:
    """Look-up of each pixel of a lens in the image of a finer and wider pinhole, at the nearest pixel.

    Attributes:
        pinhole: camera to be drawn.
    """

    def __init__(self, lens: Intrinsics) -> None:
        seen = lens.rays[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        focal_px = _FINER * np.array([lens.fx_px, lens.fy_px])
        focal_px = np.minimum(focal_px, (MOST_PIXELS - 2) / np.maximum(high - low, 1e-9))
        width, height = (np.ceil(focal_px * (high - low)) + 1).astype(int).tolist()
        self.pinhole = Intrinsics(width, height, *focal_px.tolist(), *(-focal_px * low).tolist())
        place = focal_px * (seen - low)
        nearest = np.clip(np.rint(place), 0, np.array([width, height]) - 1)
        self._shape = lens.size
        self._index = (nearest[:, 1] * width + nearest[:, 0]).astype(np.int64)
        self._beside = (place - nearest).astype(np.float32)

    def apply(self, face: NDArray[np.integer], inverse: Pixels) -> tuple[NDArray[np.integer], Pixels]:
        """Convert the pinhole's view, face (h, w) and inverse depth with its slopes (h, w, 3), to the lens's, (H, W)
        each.

        Inverse depth is in 1/m, 0 where there is nothing; its slopes along columns and rows give it off the pixel's
        middle.
        """
        found = inverse.reshape(-1, 3)[self._index]
        exact = found[:, 0] + found[:, 1] * self._beside[:, 0] + found[:, 2] * self._beside[:, 1]
        closeness = np.where(found[:, 0] > 0, exact, np.float32(0.0))
        return face.ravel()[self._index].reshape(self._shape), closeness.reshape(self._shape)
