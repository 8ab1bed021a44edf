"""The interface of motion models, for all tracks at once, and the constant-velocity model.

The models that turn are in `turning`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_positive
from coopsim.support.kernels import njit
from coopsim.tracking.motion import kalman
from coopsim.types.track_estimates import TrackEstimates

MEASURED = 7  # x, y, z, l, w, h, yaw: the order of boxes
YAW = 6

Variances = float | tuple[float, ...]
"""Variances of x, y, z, l, w, h (m^2) and yaw (rad^2): seven numbers, or one for all."""

_OF_BOXES = ("initial_variance", "process_variance_per_s", "measurement_variance")  # the fields that are Variances


@dataclass(frozen=True, slots=True, eq=False)
class Beliefs:
    """Gaussian beliefs about N objects.

    Attributes:
        mean: (N, n).
        covariance: (N, n, n).
    """

    mean: Floats
    covariance: Floats

    def __len__(self) -> int:
        return len(self.mean)


class Motion(Protocol):
    """A motion model together with its filter."""

    def initiate(self, boxes: Floats, covariance: Floats | None) -> Beliefs:
        """Return the beliefs after one measurement each, of boxes (N, 7) and their covariances (N, 7, 7).

        A matrix that is not finite, symmetric and positive definite is replaced by the model's own, which None means
        for all, and disturbs no other track.
        """

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        """Return the beliefs `dt_s` >= 0 later; the same after no time."""

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        """Return the beliefs after one more measurement each, given as in `initiate`."""

    def boxes(self, beliefs: Beliefs) -> Floats:
        """Return the boxes (N, 7): x, y, z, l, w, h, yaw."""

    def velocity(self, beliefs: Beliefs) -> Floats:
        """Return the velocities (N, 2) m/s, in the frame of the boxes."""


def initial_beliefs(boxes: Floats, covariance: Floats | None, initial: Variances, hidden: tuple[float, ...]) -> Beliefs:
    """Return the beliefs after one measurement: the box as measured, every hidden component 0.

    Args:
        boxes: (N, 7).
        covariance: see `Motion.initiate`.
        initial: variances of the boxes where `covariance` gives none.
        hidden: initial variances of the components that are not measured.
    """
    count, size = len(boxes), MEASURED + len(hidden)
    mean = np.concatenate([boxes, np.zeros((count, len(hidden)))], axis=1)
    own = diagonal(initial, hidden)
    spread = np.broadcast_to(own, (count, size, size)).copy()
    if covariance is not None:
        spread[:, :MEASURED, :MEASURED] = kalman.usable_noise(covariance, own[:MEASURED, :MEASURED])
    return Beliefs(mean, spread)


def update_beliefs(beliefs: Beliefs, boxes: Floats, covariance: Floats | None, own: Variances) -> Beliefs:
    """Return the beliefs after one more measurement of each box, the first seven components of a state.

    `own` are the variances of a measurement where `covariance` gives none.
    """
    noise = diagonal(own) if covariance is None else kalman.usable_noise(covariance, diagonal(own))
    prior, measured = np.ascontiguousarray(beliefs.mean), np.ascontiguousarray(boxes)
    mean, posterior = _update_boxes(prior, np.ascontiguousarray(beliefs.covariance), measured, kalman.stack(noise))
    return Beliefs(mean, posterior)


@njit(cache=True, nogil=True)
def _update_boxes(mean: Floats, covariance: Floats, boxes: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Update states by the boxes (N, 7) measured; `noise` is (1, 7, 7) or (N, 7, 7)."""
    innovation = boxes - mean[:, :MEASURED]
    # A detector that confuses front and back is off by half a turn: only the axis is believed. Without
    # this one wrong frame would turn the track around.
    innovation[:, YAW] = (innovation[:, YAW] + np.pi / 2) % np.pi - np.pi / 2
    moved, posterior = kalman.update_each(mean, covariance, innovation, noise)
    moved[:, YAW] = (moved[:, YAW] + np.pi) % (2 * np.pi) - np.pi
    return moved, posterior


@lru_cache(maxsize=64)
def diagonal(variances: Variances, hidden: tuple[float, ...] = ()) -> Floats:
    """Return the matrix (7 + k, 7 + k) of the variances of boxes and of k hidden components; read-only."""
    matrix: Floats = np.diag(np.concatenate([np.broadcast_to(variances, MEASURED), hidden]))
    matrix.flags.writeable = False
    return matrix


def check_parameters(model: Any) -> None:
    """Check that every field of a model is a number > 0; variances of a box may be seven, and become tuples."""
    for field in fields(model):
        value = getattr(model, field.name)
        if np.ndim(value) == 0:
            require_positive(**{field.name: value})
        elif field.name not in _OF_BOXES or np.shape(value) != (MEASURED,):
            wanted = "a number, or 7" if field.name in _OF_BOXES else "a number"
            raise InvalidValueError(f"{field.name} must be {wanted}, got {value!r}")
        else:
            require_positive(**{f"{field.name}[{k}]": each for k, each in enumerate(value)})
            object.__setattr__(model, field.name, tuple(float(each) for each in value))


_ROWS, _COLUMNS = np.ix_([0, 1, 7, 8], [0, 1, 7, 8])  # x, y, vx, vy in the state of `ConstantVelocity`


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """Constant velocity with state x, y, z, l, w, h, yaw, vx, vy, vz (Weng et al. 2020, sec. III-B).

    AB3DMOT counts time in frames of 0.1 s: initial variances 10 and 10,000, process noise 1 and 0.01, measurement
    noise 1. These are the same numbers in SI units, with process noise growing with time, so that at `dt_s` = 0.1 the
    filter is AB3DMOT's, and at any other it is consistent with it.

    Attributes:
        initial_variance: variance of the measured components (m^2, rad^2), when a track begins.
        initial_velocity_variance: (m/s)^2, when a track begins.
        process_variance_per_s: growth of the variance of the measured components, per second.
        process_velocity_variance_per_s: growth of the variance of velocity, (m/s)^2 per second.
        measurement_variance: variance of a measurement whose detection states no covariance.
    """

    initial_variance: Variances = 10.0
    initial_velocity_variance: float = 1e6
    process_variance_per_s: Variances = 10.0
    process_velocity_variance_per_s: float = 10.0
    measurement_variance: Variances = 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    def initiate(self, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return initial_beliefs(boxes, covariance, self.initial_variance, (self.initial_velocity_variance,) * 3)

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        return Beliefs(*kalman.predict(beliefs.mean, beliefs.covariance, *self._dynamics(dt_s)))

    def planar(self, dt_s: float) -> tuple[Floats, Floats]:
        """Return F and Q, (4, 4) each, of x, y, vx, vy alone, on which the rest of the state does not act."""
        transition, process = self._dynamics(dt_s)
        return transition[_ROWS, _COLUMNS], process[_ROWS, _COLUMNS]

    @staticmethod
    def planar_covariance(beliefs: Beliefs) -> Floats:
        """Return the covariances (N, 4, 4) of x, y, vx, vy."""
        return beliefs.covariance[:, _ROWS, _COLUMNS]

    def predict_estimates(self, estimates: TrackEstimates, dt_s: float) -> TrackEstimates:
        """Return tracks' planar estimates `dt_s` >= 0 later."""
        mean, covariance = kalman.predict(estimates.mean, estimates.covariance, *self.planar(dt_s))
        return estimates.with_planar_states(mean, covariance)

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return update_beliefs(beliefs, boxes, covariance, self.measurement_variance)

    def boxes(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, :MEASURED]

    def velocity(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, MEASURED : MEASURED + 2]

    def _dynamics(self, dt_s: float) -> tuple[Floats, Floats]:
        """Return F and Q, (10, 10) each."""
        growth = diagonal(self.process_variance_per_s, (self.process_velocity_variance_per_s,) * 3)
        return _constant_velocity(dt_s), growth * dt_s


@lru_cache(maxsize=64)
def _constant_velocity(dt_s: float) -> Floats:
    """Return F, (10, 10), read-only."""
    transition: Floats = np.eye(10)
    transition[[0, 1, 2], [7, 8, 9]] = dt_s
    transition.flags.writeable = False
    return transition
