"""Weighted least squares for three unknowns, with priors, that trusts equations less the worse they fit."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit

_STEPS = 4


@njit(cache=True, nogil=True, error_model="numpy")
def robust_least_squares(
    rows: Floats, target_m: Floats, weight: Floats, noise_m: float, expected: Floats, outlier_m: float
) -> Floats:
    """Return the most likely x (3,) of `rows` x = `target_m`, reweighted by how well each fits (Cauchy's weights).

    Args:
        rows: (N, D, 3) D equations of each of N observations.
        target_m: (N, D) m.
        weight: (N,) of each observation.
        noise_m: standard deviation of an equation.
        expected: (3,) standard deviations of the unknowns, whose expected values are 0.
        outlier_m: residual (norm over D) m from which an observation counts little.
    """
    trusted, found = weight.copy(), np.zeros(3)
    for _ in range(_STEPS):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for n in range(len(rows)):
            for row, value in zip(rows[n], target_m[n]):  # noqa: B905  (numba has no strict)
                for i in range(3):
                    right[i] += trusted[n] * row[i] * value
                    for j in range(i + 1):
                        normal[i, j] += trusted[n] * row[i] * row[j]
        for i in range(3):
            normal[i, : i + 1] /= noise_m * noise_m
            normal[i, i] += 1 / (expected[i] * expected[i])
        found = _solve(normal, right / (noise_m * noise_m))
        for n in range(len(rows)):
            squares = 0.0
            for row, value in zip(rows[n], target_m[n]):  # noqa: B905
                error_m = row[0] * found[0] + row[1] * found[1] + row[2] * found[2] - value
                squares += error_m * error_m
            trusted[n] = weight[n] / (1 + squares / (outlier_m * outlier_m))
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(matrix: Floats, right: Floats) -> Floats:
    """Return x (3,) of `matrix` x = `right`, for a positive definite matrix given by its lower half (Cholesky).

    The arguments serve as workspace.
    """
    for i in range(3):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(rest) if i == j else rest / matrix[j, j]
    for i in range(3):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
    return right
