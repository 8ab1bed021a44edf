"""How tracked objects move, for all tracks at once."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np

from coopsim.checks import require_positive
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.tracking import kalman

MEASURED = 7  # x, y, z, l, w, h, yaw: the order of boxes
_YAW = 6


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
        """Beliefs after one measurement each: boxes (N, 7), and their covariance (N, 7, 7) if known."""

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        """Beliefs `dt_s` later."""

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        """Beliefs after one more measurement each, as in `initiate`."""

    def boxes(self, beliefs: Beliefs) -> Floats:
        """(N, 7): x, y, z, l, w, h, yaw."""

    def velocity(self, beliefs: Beliefs) -> Floats:
        """(N, 2) m/s."""


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

    initial_variance: float = 10.0
    initial_velocity_variance: float = 1e6
    process_variance_per_s: float = 10.0
    process_velocity_variance_per_s: float = 10.0
    measurement_variance: float = 1.0

    def __post_init__(self) -> None:
        require_positive(**asdict(self))

    def initiate(self, boxes: Floats, covariance: Floats | None) -> Beliefs:
        mean = np.concatenate([boxes, np.zeros((len(boxes), 3))], axis=1)
        variance = [self.initial_variance] * MEASURED + [self.initial_velocity_variance] * 3
        initial = np.broadcast_to(np.diag(variance), (len(boxes), 10, 10)).copy()
        if covariance is not None:
            initial[:, :MEASURED, :MEASURED] = covariance
        return Beliefs(mean, initial)

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        transition = np.eye(10)
        transition[[0, 1, 2], [7, 8, 9]] = dt_s
        growth = [self.process_variance_per_s] * MEASURED + [self.process_velocity_variance_per_s] * 3
        process = np.diag(growth) * dt_s
        return Beliefs(*kalman.predict(beliefs.mean, beliefs.covariance, transition, process))

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        innovation = boxes - beliefs.mean[:, :MEASURED]
        # A detector that confuses front and back is off by half a turn: only the axis is believed. Without
        # this one wrong frame would turn the track around.
        innovation[:, _YAW] = (innovation[:, _YAW] + np.pi / 2) % np.pi - np.pi / 2
        noise = np.eye(MEASURED) * self.measurement_variance if covariance is None else covariance
        mean, posterior = kalman.update(beliefs.mean, beliefs.covariance, innovation, noise)
        mean[:, _YAW] = wrap_angle(mean[:, _YAW])
        return Beliefs(mean, posterior)

    def boxes(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, :MEASURED]

    def velocity(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, MEASURED : MEASURED + 2]
