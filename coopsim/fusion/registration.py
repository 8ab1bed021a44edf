"""Registration of one agent's boxes with another's by the objects that both see: shift, turn, height and tilt.

Received boxes come through a relative pose that is never exact, least of all in tilt, and from a sweep that was taken
some milliseconds earlier or later, in which a car at 10 m/s moves by decimetres. `alignment` corrects a sender's pose
over ground and over time, and places all its boxes by that. Registration needs less and changes nothing: from the boxes
of one moment alone it gives the positions at which the receiver would detect the objects that it misses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry.box_matching import Likeness, ScoredBoxes, match_boxes
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, Mask
from coopsim.support.kernels import njit

_ROUNDS, _GATE = 2, -0.2
"""Number of rounds, each matching the boxes under the registration of the round before; smallest BEV GIoU of a pair."""

_SHIFT = np.array([0.7, 0.7, np.radians(1.0)])
_RISE = np.array([0.7, 0.1, 0.1])
"""Standard deviations of the priors: x, y m and heading rad; height m, and its slopes along x and y, which in practice
the boxes alone decide."""

_NOISE_M = 0.4
"""Standard deviation of a box's own error, over ground and in height."""

_OVER_GROUND_M, _IN_HEIGHT_M = 0.6, 0.4
"""Residual from which a pair counts little: two cars, or a height without a road."""

_FARTHEST_M = 1e5
"""Boxes farther away are ignored: their squares might overflow."""


class Registration(NamedTuple):
    """A transform that moves the other agent's boxes onto the own ones.

    Attributes:
        middle: (2,) m, centre of the turn and the tilt.
        shift: (3,) x, y m over ground, and the turn in rad.
        rise: (3,) m up at the middle, and the slopes along x and y, metres up per metre.
        common: number of objects that both agents see.
    """

    middle: Floats
    shift: Floats
    rise: Floats
    common: int = 0


@njit(cache=True, nogil=True)
def register_rows(
    own: Floats, own_score: Floats, own_label: Ints, other: Floats, other_score: Floats, other_label: Ints
) -> tuple[Registration, Floats, Ints, Floats]:
    """Register another agent's boxes (M, 7) with the own ones (N, 7) by the most likely transform, in one frame.

    Pairs of a class are matched (Hungarian on the BEV GIoU), and shift and rise follow by least squares with Gaussian
    priors, each reweighted by how well pairs agree (Cauchy's weights). A turn is taken as small. Without common objects
    the registration moves nothing.

    Returns:
        The registration; the other boxes (M, 7) under it; and the pairs under it, as from `match_boxes`.
    """
    near, own_near = _near(other), _near(own)
    found = Registration(_middle(other, near), np.zeros(3), np.zeros(3), 0)
    fitted = np.full(len(other), -1)
    for number in range(_ROUNDS + 1):
        placed = place(found, other)
        theirs_now = ScoredBoxes(placed, other_score, other_label)
        own_row, giou = match_boxes(ScoredBoxes(own, own_score, own_label), theirs_now, Likeness(False, 0.0))
        if number == _ROUNDS:
            break
        pairs = np.full(len(other), -1)
        for k in range(len(other)):
            if giou[k] >= _GATE and near[k] and own_near[own_row[k]]:
                pairs[k] = own_row[k]
        theirs = np.flatnonzero(pairs >= 0)
        if len(theirs) == 0 or np.array_equal(pairs, fitted):  # the same pairs give the same result
            break
        fitted = pairs
        found = _fit(found.middle, own[pairs[theirs]], own_score[pairs[theirs]], other[theirs], other_score[theirs])
    return found, placed, own_row, giou


@njit(cache=True, nogil=True)
def place(registration: Registration, boxes: Floats) -> Floats:
    """Return boxes (N, 7) moved onto the own ones."""
    middle, shift, rise, _ = registration
    cos, sin = np.cos(shift[2]), np.sin(shift[2])
    placed = boxes.copy()
    for k in range(len(boxes)):
        x, y = boxes[k, 0] - middle[0], boxes[k, 1] - middle[1]
        placed[k, 0] = middle[0] + shift[0] + (x * cos - y * sin)
        placed[k, 1] = middle[1] + shift[1] + (x * sin + y * cos)
        placed[k, 2] = boxes[k, 2] + rise[0] + (x * rise[1] + y * rise[2])
        placed[k, 6] = (boxes[k, 6] + shift[2] + np.pi) % (2 * np.pi) - np.pi
    return placed


@njit(cache=True, nogil=True)
def _middle(boxes: Floats, near: Mask) -> Floats:
    """Return the mean centre (2,) m over ground of the boxes that are near; the origin without any."""
    total, count = np.zeros(2), 0
    for k in range(len(boxes)):
        if near[k]:
            total += boxes[k, :2]
            count += 1
    return total / max(count, 1)


@njit(cache=True, nogil=True)
def _near(boxes: Floats) -> Mask:
    """Return the mask (N,) of boxes within `_FARTHEST_M` of the origin."""
    near = np.empty(len(boxes), dtype=np.bool_)
    for k in range(len(boxes)):
        near[k] = max(abs(boxes[k, 0]), abs(boxes[k, 1]), abs(boxes[k, 2])) <= _FARTHEST_M
    return near


@njit(cache=True, nogil=True)
def _fit(middle: Floats, own: Floats, own_score: Floats, other: Floats, other_score: Floats) -> Registration:
    """Return the registration of K pairs of boxes, (K, 7) each, around a middle (2,) m."""
    count = len(own)
    weight = np.empty(count)
    over_ground, apart = np.zeros((count, 2, 3)), np.empty((count, 2))
    in_height, higher = np.ones((count, 1, 3)), np.empty((count, 1))
    for k in range(count):
        weight[k] = min(max(min(own_score[k], other_score[k]), 1e-3), 1.0)
        x, y = other[k, 0] - middle[0], other[k, 1] - middle[1]
        over_ground[k, 0, 0], over_ground[k, 0, 2] = 1.0, -y
        over_ground[k, 1, 1], over_ground[k, 1, 2] = 1.0, x
        in_height[k, 0, 1], in_height[k, 0, 2] = x, y
        apart[k] = own[k, :2] - other[k, :2]
        higher[k, 0] = (own[k, 2] - own[k, 5] / 2) - (other[k, 2] - other[k, 5] / 2)
    shift = robust_least_squares(over_ground, apart, weight, _NOISE_M, _SHIFT, _OVER_GROUND_M)
    rise = robust_least_squares(in_height, higher, weight, _NOISE_M, _RISE, _IN_HEIGHT_M)
    return Registration(middle, shift, rise, count)


_STEPS = 4


@njit(cache=True, nogil=True, error_model="numpy")
def robust_least_squares(
    rows: Floats, target_m: Floats, weight: Floats, noise_m: float, expected: Floats, outlier_m: float
) -> Floats:
    """Return the most likely x (3,) of `rows` x = `target_m`, reweighted by how well each fits (Cauchy's weights).

    Args:
        rows: (N, D, 3) D equations of each of N observations.
        target_m: (N, D) m.
        weight: (N,)
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
