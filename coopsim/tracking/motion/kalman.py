"""The Kalman filter for N independent states at once, whose first m components are measured directly.

With H = [I 0], H P H^T is a block of P and P H^T its first columns, so no product with H is ever formed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats


def predict(mean: Floats, covariance: Floats, transition: Floats, process: Floats) -> tuple[Floats, Floats]:
    """Predict: x' = F x, P' = F P F^T + Q (Kalman 1960).

    Args:
        mean: (N, n).
        covariance: (N, n, n).
        transition: F, (n, n).
        process: Q, (n, n).
    """
    return mean @ transition.T, spread(covariance, transition, process)


def spread(covariance: Floats, transition: Floats, process: Floats) -> Floats:
    """Predict covariances, also of an extended filter: F P F^T + Q, (N, n, n).

    Args:
        covariance: P, (N, n, n).
        transition: F, (n, n), or a Jacobian each, (N, n, n).
        process: Q, (n, n) or (N, n, n).
    """
    return transition @ covariance @ transition.swapaxes(-1, -2) + process


def update(mean: Floats, covariance: Floats, innovation: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Update: x' = x + K y, P' = (I - K H) P (I - K H)^T + K R K^T, with K = P H^T (H P H^T + R)^-1.

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


def usable_noise(stated: Floats, own: Floats) -> Floats:
    """Return the stated covariances (N, m, m), with the model's own in place of each invalid one.

    A covariance must be finite, symmetric and positive definite. Detections come from other agents too, and a single
    invalid matrix would stop the solver for all tracks.

    Args:
        stated: (N, m, m).
        own: (m, m).
    """
    good = _are_covariances(stated)
    return stated if good.all() else np.where(good[:, None, None], stated, own)


def _are_covariances(matrices: Floats) -> NDArray[np.bool_]:
    """Return which matrices (N,) are finite, symmetric up to rounding, and positive definite."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    sound = np.where(finite[:, None, None], matrices, 0.0)
    # Rounding in single precision, on the way through a message, may spoil symmetry by this much.
    rounding = 1e-6 * np.abs(sound).max(axis=(1, 2), initial=0.0)
    skew = np.abs(sound - sound.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    good: NDArray[np.bool_] = np.asarray(finite & (skew <= rounding))
    try:
        np.linalg.cholesky(sound[good])
    except np.linalg.LinAlgError:  # at least one is not; the error does not say which
        good[good] = np.linalg.eigvalsh(sound[good])[:, 0] > 0
    return good
