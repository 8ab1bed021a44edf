"""Brown-Conrady lens distortion, with OpenCV's coefficients in OpenCV's order.

A point (x, y) of the normalised image plane (z = 1), at r^2 = x^2 + y^2, is seen at

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

Brown, "Decentering Distortion of Lenses", Photogrammetric Engineering 1966; OpenCV, camera calibration.
"""

from __future__ import annotations

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats

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

    Raises:
        InvalidValueError: the distortion is not one to one within these points.
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
