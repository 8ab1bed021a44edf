"""The Kalman filter for N independent states at once, whose first m components are measured directly.

With H = [I 0], H P H^T is a block of P and P H^T its first columns, so no product with H is ever formed.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats


def predict(mean: Floats, covariance: Floats, transition: Floats, process: Floats) -> tuple[Floats, Floats]:
    """X' = F x, P' = F P F^T + Q (Kalman 1960).

    Args:
        mean: (N, n).
        covariance: (N, n, n).
        transition: F, (n, n).
        process: Q, (n, n).
    """
    return mean @ transition.T, transition @ covariance @ transition.T + process


def update(mean: Floats, covariance: Floats, innovation: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """X' = x + K y, P' = (I - K H) P (I - K H)^T + K R K^T, with K = P H^T (H P H^T + R)^-1.

    The Joseph form: it keeps P symmetric and positive definite through rounding.

    Args:
        mean: (N, n).
        covariance: (N, n, n).
        innovation: y, measured less predicted, (N, m).
        noise: R, (m, m) or (N, m, m).
    """
    measured = innovation.shape[1]
    cross = covariance[:, :, :measured]
    # S is symmetric, so K^T = S^-1 (P H^T)^T.
    gain = np.linalg.solve(cross[:, :measured] + noise, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
    keep = np.broadcast_to(np.eye(mean.shape[1]), covariance.shape).copy()
    keep[:, :, :measured] -= gain
    posterior = keep @ covariance @ keep.transpose(0, 2, 1) + gain @ noise @ gain.transpose(0, 2, 1)
    moved = mean + (gain @ innovation[:, :, None])[:, :, 0]
    return moved, (posterior + posterior.transpose(0, 2, 1)) / 2
