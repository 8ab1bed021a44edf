"""Estimation of a pose's error over time: its size, its persistence, and its value now.

The noise may be fresh in every frame (the papers' protocol), wander or stay, and which of them is unknown. All three
are a process e_t = r e_(t-1) + sqrt(1 - r^2) v_t with variance V (AR(1); an Ornstein-Uhlenbeck process in frames), with
r = 0 for white noise and r = 1 for a bias. V and r are learned from the measurements, by moments. They set the gain:
with r = 0 an error is found from this frame's objects alone, with r = 1 from those of all frames together.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.types import Odometry, PoseEstimate, stack_xyz_yaw

_KEPT = 0.97
"""Share of the learned moments that is kept from one message to the next: some three seconds at 10 Hz."""

_FRAMES = 5.0
"""Number of frames that the assumed or stated variance counts for."""

_LEAST = np.square([0.02, 0.02, 0.0004])
"""Smallest variance of x, y (m^2) and heading (rad^2)."""

_MOST_R = 0.99


class Moments:
    """Variance and correlation of a zero-mean process that is measured with known noise; x and y are alike.

    Args:
        variance: (3,) initial variance of x, y (m^2) and heading (rad^2).
    """

    def __init__(self, variance: Floats) -> None:
        self._first = np.maximum(variance, _LEAST)
        self._weight, self._square, self._product = np.zeros(3), np.zeros(3), np.zeros(3)
        self._before: Floats | None = None

    @property
    def variance(self) -> Floats:
        """The variance V (3,)."""
        learned = (_FRAMES * self._first + self._square) / (_FRAMES + self._weight)
        return np.maximum(_alike(learned), _LEAST)

    @property
    def correlation(self) -> Floats:
        """The correlation r (3,), in [0, 0.99]."""
        power = np.maximum(_alike(self._square), 0.0) + self.variance  # one more frame, with no correlation
        return np.clip(_alike(self._product) / power, 0.0, _MOST_R)

    def forget(self) -> None:
        """Discount the moments by one frame."""
        for sums in (self._weight, self._square, self._product):
            sums *= _KEPT

    def learn(self, value: Floats, noise: Floats) -> None:
        """Add a measurement (3,) with the variance (3,) of its noise; a noisy measurement counts little."""
        weight = self.variance / (self.variance + noise)
        self._weight += weight
        self._square += weight * (value**2 - noise)
        if self._before is not None:
            self._product += weight * value * self._before
        self._before = value


def _alike(values: Floats) -> Floats:
    """Average the values of x and y."""
    planar = (values[0] + values[1]) / 2
    return np.array([planar, planar, values[2]])


class PoseErrorFilter:
    """A Kalman filter of one agent's correction (x, y, heading), with a learned model.

    Attributes:
        mean: (3,) the correction, m and rad.
        covariance: (3, 3).

    Args:
        variance: (3,) variance of the error, as stated or assumed.
    """

    def __init__(self, variance: Floats) -> None:
        self._moments = Moments(variance)
        self.mean, self.covariance = np.zeros(3), np.diag(self._moments.variance)

    def predict(self) -> None:
        """Predict the correction to the next message."""
        self._moments.forget()
        kept = self._moments.correlation
        fresh = np.diag((1 - kept**2) * self._moments.variance)
        self.mean, self.covariance = kept * self.mean, np.outer(kept, kept) * self.covariance + fresh

    def update(self, mean: Floats, covariance: Floats) -> None:
        """Take over the correction (3,) and covariance (3, 3) estimated from prediction and this frame's objects."""
        prior, posterior = np.linalg.inv(self.covariance), np.linalg.inv(covariance)
        # The objects' information alone is the posterior's less the prediction's. A direction without any would make it
        # singular: it gets next to no weight.
        data = posterior - prior + np.diag(1e-3 / self._moments.variance)
        noise = np.linalg.inv(data)
        measured = noise @ (posterior @ mean - prior @ self.mean)
        if np.isfinite(measured).all() and (np.diagonal(noise) > 0).all():
            self._moments.learn(measured, np.diagonal(noise))
        self.mean, self.covariance = mean, covariance


class OwnPose:
    """An agent's own pose, with its white noise averaged out along the odometry.

    The gain follows from the scatter of the stated pose about the pose that odometry carries on: an error that wanders
    or stays scatters little, is followed, and is left to the shared objects.

    Attributes:
        xyz_yaw: (4,) the pose, m and rad.
    """

    def __init__(self, first: PoseEstimate, variance: Floats) -> None:
        self.xyz_yaw = first.xyz_yaw
        self._variance = np.maximum(variance, _LEAST)
        self._moments = Moments(variance)

    def step(self, stated: PoseEstimate, odometry: Odometry) -> SE3:
        """Return the pose one frame later, `world_SE3_base`: carried on by odometry and drawn to the stated pose."""
        before = SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))
        carried = stack_xyz_yaw(before.compose(odometry.previous_SE3_current))
        surprise = stated.xyz_yaw - carried
        surprise[3] = wrap_angle(surprise[3])
        predicted = self._variance + _STEP
        self._moments.forget()
        self._moments.learn(surprise[[0, 1, 3]], predicted)
        gain = predicted / (predicted + self._moments.variance)
        self._variance = (1 - gain) * predicted
        self.xyz_yaw = carried + np.array([gain[0], gain[1], 1.0, gain[2]]) * surprise
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


_STEP = np.square([0.01, 0.01, 0.0005])
"""Variance of a frame's odometry, m^2 and rad^2: twice the default noise of `LocalizationConfig`."""
