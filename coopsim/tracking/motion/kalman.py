"""The Kalman filter for N independent states at once, whose first m components are measured directly.

With H = [I 0], H P H^T is a block of P and P H^T its first columns, so no product with H is ever formed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints
from coopsim.support.kernels import njit


def predict(mean: Floats, covariance: Floats, transition: Floats, process: Floats) -> tuple[Floats, Floats]:
    """Predict: x' = F x, P' = F P F^T + Q (Kalman 1960), of x (N, n) and P (N, n, n) by F and Q (n, n)."""
    return mean @ transition.T, spread(covariance, transition, process)


def spread(covariance: Floats, transition: Floats, process: Floats) -> Floats:
    """Predict covariances P (N, n, n), also of an extended filter: F P F^T + Q, with one F or a Jacobian (N, n, n)."""
    predicted: Floats = _spread(np.ascontiguousarray(covariance), stack(transition), process)
    return predicted


def update(mean: Floats, covariance: Floats, innovation: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Update: x' = x + K y, P' = (I - K H) P (I - K H)^T + K R K^T, with K = P H^T (H P H^T + R)^-1.

    The Joseph form: it keeps P symmetric and positive definite through rounding. The innovation y (N, m) is measured
    less predicted, and the noise R is (m, m) or (N, m, m).
    """
    moved, posterior = update_each(
        np.ascontiguousarray(mean),
        np.ascontiguousarray(covariance),
        np.ascontiguousarray(innovation),
        stack(noise),
    )
    return moved, posterior


def usable_noise(stated: Floats, own: Floats) -> Floats:
    """Return the stated covariances (N, m, m), with the model's own in place of each invalid one.

    A covariance must be finite, symmetric and positive definite. Detections come from other agents too, and a single
    invalid matrix would spoil its track.
    """
    good = _are_covariances(stated)
    return stated if good.all() else np.where(good[:, None, None], stated, own)


def _are_covariances(matrices: Floats) -> NDArray[np.bool_]:
    """Return the mask (N,) of matrices that are finite, symmetric up to rounding, and positive definite.

    Rounding in single precision, on the way through a message, may spoil symmetry by 1e-6 of the largest element.
    """
    good: NDArray[np.bool_] = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    finite = np.where(good[:, None, None], matrices, np.eye(matrices.shape[1]))
    skew = np.abs(finite - finite.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    good &= skew <= 1e-6 * np.abs(finite).max(axis=(1, 2), initial=0.0)
    return good if _have_factors(finite) else good & [_have_factors(each) for each in finite]


def _have_factors(matrices: Floats) -> bool:
    """Return whether all matrices (..., m, m) have a Cholesky factor."""
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return False
    return True


def stack(matrices: Floats) -> Floats:
    """Return one matrix for all, (k, k), as (1, k, k); one each, (N, k, k), as they are."""
    return np.ascontiguousarray(matrices if matrices.ndim == 3 else matrices[None])


# Zeros are left out of all sums below: most of F is 0, and of a gain where covariances are nearly diagonal.


@njit(cache=True, nogil=True)
def _spread(covariance: Floats, transition: Floats, process: Floats) -> Floats:
    """Return F P F^T + Q."""
    count, size = len(covariance), covariance.shape[1]
    out, half = np.empty((count, size, size)), np.empty((size, size))
    places, number = np.zeros((size, size), np.int64), np.zeros(size, np.int64)
    for k in range(count):
        f = k if len(transition) > 1 else 0
        if k == f:
            _find_factors(transition[f], places, number)
        for i in range(size):
            for j in range(size):
                half[i, j] = 0.0
            for at in places[i, : number[i]]:
                factor = transition[f, i, at]
                for j in range(size):
                    half[i, j] += factor * covariance[k, at, j]
        for i in range(size):
            for j in range(size):
                value = process[i, j]
                for at in places[j, : number[j]]:
                    value += half[i, at] * transition[f, j, at]
                out[k, i, j] = value
    return out


@njit(cache=True, nogil=True)
def _find_factors(matrix: Floats, places: Ints, number: Ints) -> None:
    """Write the places (n, n) of the elements of each row that are not 0, and their number (n,)."""
    for i in range(len(matrix)):
        number[i] = 0
        for j in range(len(matrix)):
            if matrix[i, j] != 0:
                places[i, number[i]] = j
                number[i] += 1


@njit(cache=True, nogil=True)
def update_each(mean: Floats, covariance: Floats, innovation: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Update as `update` does; all arrays are contiguous, and `noise` is (1, m, m) or (N, m, m)."""
    count, size = mean.shape
    measured = innovation.shape[1]
    moved, posterior = np.empty((count, size)), np.empty((count, size, size))
    system, gain = np.empty((measured, measured)), np.empty((measured, size))
    kept, noisy = np.empty((size, size)), np.empty((size, measured))
    for k in range(count):
        r = k if len(noise) > 1 else 0
        for i in range(measured):
            for j in range(measured):
                system[i, j] = covariance[k, i, j] + noise[r, i, j]
            for j in range(size):
                gain[i, j] = covariance[k, j, i]
        _solve(system, gain)
        for i in range(size):
            moved[k, i] = mean[k, i]
        for at in range(measured):
            for i in range(size):
                moved[k, i] += gain[at, i] * innovation[k, at]
        _joseph(k, r, covariance, gain, noise, kept, noisy, posterior)
    return moved, posterior


@njit(cache=True, nogil=True)
def _joseph(
    k: int, r: int, covariance: Floats, gain: Floats, noise: Floats, kept: Floats, noisy: Floats, out: Floats
) -> None:
    """Write the posterior covariance of object `k`, with noise `r`, into `out`; `gain` is K^T, (m, n).

    With A = (I - K H) P, the Joseph form is A - A H^T K^T + K R K^T.
    """
    measured, size = gain.shape
    for i in range(size):
        for j in range(size):
            kept[i, j] = covariance[k, i, j]
        for j in range(measured):
            noisy[i, j] = 0.0
        for at in range(measured):
            factor = gain[at, i]
            if factor == 0:
                continue
            for j in range(size):
                kept[i, j] -= factor * covariance[k, at, j]
            for j in range(measured):
                noisy[i, j] += factor * noise[r, at, j]
    for i in range(size):
        for j in range(size):
            out[k, i, j] = kept[i, j]
        for at in range(measured):
            change = noisy[i, at] - kept[i, at]
            if change != 0:
                for j in range(size):
                    out[k, i, j] += change * gain[at, j]
    for i in range(size):
        for j in range(i):
            out[k, i, j] = out[k, j, i] = (out[k, i, j] + out[k, j, i]) / 2


@njit(cache=True, nogil=True)
def _solve(system: Floats, right: Floats) -> None:
    """Solve S X = B in the place of B (m, n), by S = L D L^T, which takes the place of S (m, m)."""
    size, width = right.shape
    for j in range(size):
        for i in range(j + 1, size):
            ratio = system[i, j] / system[j, j]
            if ratio != 0:
                for k in range(j + 1, i + 1):
                    system[i, k] -= ratio * system[k, j]
        for i in range(j + 1, size):
            system[i, j] /= system[j, j]
    for i in range(size):
        for j in range(i):
            factor = system[i, j]
            if factor != 0:
                for k in range(width):
                    right[i, k] -= factor * right[j, k]
    for i in range(size - 1, -1, -1):
        for k in range(width):
            right[i, k] /= system[i, i]
        for j in range(i + 1, size):
            factor = system[j, i]
            if factor != 0:
                for k in range(width):
                    right[i, k] -= factor * right[j, k]
