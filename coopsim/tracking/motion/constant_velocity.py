"""How tracked objects move, for all tracks at once: what every model shares, and constant velocity.

The models that turn are in `turning`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.checks import require_positive
from coopsim.tracking.motion import kalman

MEASURED = 7  # x, y, z, l, w, h, yaw: the order of boxes
YAW = 6

Variances = float | tuple[float, ...]
"""Of x, y, z, l, w, h (m^2) and yaw (rad^2): seven numbers, or one for all."""

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
        """Beliefs after one measurement each.

        Args:
            boxes: (N, 7).
            covariance: of the boxes, (N, 7, 7), or None for the model's own. One that is not finite, symmetric and
                positive definite is replaced by the model's own, and disturbs no other track.
        """

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        """Beliefs `dt_s` >= 0 later; after no time, the same."""

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        """Beliefs after one more measurement each, as in `initiate`."""

    def boxes(self, beliefs: Beliefs) -> Floats:
        """(N, 7): x, y, z, l, w, h, yaw."""

    def velocity(self, beliefs: Beliefs) -> Floats:
        """(N, 2) m/s, in the frame of the boxes."""

    def measurement_covariance(self, beliefs: Beliefs) -> Floats:
        """S = H P H^T + R, (N, 7, 7): how far a measurement of the object may lie from `boxes`.

        R is the model's own; y^T S^-1 y is the squared Mahalanobis distance of an innovation y.
        """


def born(boxes: Floats, covariance: Floats | None, initial: Variances, hidden: tuple[float, ...]) -> Beliefs:
    """Beliefs after one measurement: the box as measured, everything that is not measured 0.

    Args:
        boxes: (N, 7).
        covariance: of the boxes, as in `Motion.initiate`.
        initial: variances of the boxes where `covariance` does not say.
        hidden: variances of what is not measured, at birth.
    """
    count, size = len(boxes), MEASURED + len(hidden)
    mean = np.concatenate([boxes, np.zeros((count, len(hidden)))], axis=1)
    own = diagonal(initial, hidden)
    spread = np.broadcast_to(own, (count, size, size)).copy()
    if covariance is not None:
        spread[:, :MEASURED, :MEASURED] = kalman.usable_noise(covariance, own[:MEASURED, :MEASURED])
    return Beliefs(mean, spread)


def corrected(beliefs: Beliefs, boxes: Floats, covariance: Floats | None, own: Variances) -> Beliefs:
    """Beliefs after one more measurement.

    Args:
        beliefs: of N objects, whose first seven components are their boxes.
        boxes: (N, 7).
        covariance: of the boxes, as in `Motion.update`.
        own: variances of a measurement where `covariance` does not say.
    """
    innovation = boxes - beliefs.mean[:, :MEASURED]
    # A detector that confuses front and back is off by half a turn: only the axis is believed. Without
    # this one wrong frame would turn the track around.
    innovation[:, YAW] = (innovation[:, YAW] + np.pi / 2) % np.pi - np.pi / 2
    noise = diagonal(own) if covariance is None else kalman.usable_noise(covariance, diagonal(own))
    mean, posterior = kalman.update(beliefs.mean, beliefs.covariance, innovation, noise)
    mean[:, YAW] = wrap_angle(mean[:, YAW])
    return Beliefs(mean, posterior)


def measurable(beliefs: Beliefs, own: Variances) -> Floats:
    """`Motion.measurement_covariance`, where a measurement has the variances `own`."""
    return beliefs.covariance[:, :MEASURED, :MEASURED] + diagonal(own)


def diagonal(variances: Variances, hidden: tuple[float, ...] = ()) -> Floats:
    """(7 + k, 7 + k): the variances of boxes and of k hidden components, on the diagonal."""
    return np.diag(np.concatenate([np.broadcast_to(variances, MEASURED), hidden]))


def check_parameters(model: Any) -> None:
    """Every field must be a number > 0; those of a box may be seven, and become tuples."""
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
        initial_variance: of what is measured (m^2, rad^2), at birth.
        initial_velocity_variance: (m/s)^2, at birth.
        process_variance_per_s: growth of the variance of what is measured, per second.
        process_velocity_variance_per_s: growth of the variance of velocity, (m/s)^2 per second.
        measurement_variance: of a measurement whose detection states none.
    """

    initial_variance: Variances = 10.0
    initial_velocity_variance: float = 1e6
    process_variance_per_s: Variances = 10.0
    process_velocity_variance_per_s: float = 10.0
    measurement_variance: Variances = 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    def initiate(self, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return born(boxes, covariance, self.initial_variance, (self.initial_velocity_variance,) * 3)

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        return Beliefs(*kalman.predict(beliefs.mean, beliefs.covariance, *self._dynamics(dt_s)))

    def planar(self, dt_s: float) -> tuple[Floats, Floats]:
        """F and Q, (4, 4) each, of the state x, y, vx, vy alone, which the rest of the state does not act on."""
        transition, process = self._dynamics(dt_s)
        return transition[_ROWS, _COLUMNS], process[_ROWS, _COLUMNS]

    @staticmethod
    def planar_covariance(beliefs: Beliefs) -> Floats:
        """(N, 4, 4) of x, y, vx, vy."""
        return beliefs.covariance[:, _ROWS, _COLUMNS]

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return corrected(beliefs, boxes, covariance, self.measurement_variance)

    def boxes(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, :MEASURED]

    def velocity(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, MEASURED : MEASURED + 2]

    def measurement_covariance(self, beliefs: Beliefs) -> Floats:
        return measurable(beliefs, self.measurement_variance)

    def _dynamics(self, dt_s: float) -> tuple[Floats, Floats]:
        """F and Q, (10, 10) each."""
        transition = np.eye(10)
        transition[[0, 1, 2], [7, 8, 9]] = dt_s
        return transition, diagonal(self.process_variance_per_s, (self.process_velocity_variance_per_s,) * 3) * dt_s
