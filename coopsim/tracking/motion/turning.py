"""Motion models that turn: constant turn rate, with constant speed (CTRV) or acceleration (CTRA).

Their states begin with the box, as all do: x, y, z, l, w, h, yaw, speed, turn rate, climb[, acceleration]. Speed
and acceleration are along the heading; climb is the velocity along z. Both are extended Kalman filters with analytic
Jacobians. With the ground plane as complex numbers, theta the yaw, w the turn rate and T the time step,

    displacement = integral over t in [0, T] of (v + a t) exp(i (theta + w t)) = exp(i theta) (v T E0 + a T^2 E1),

where E_k(w T) are the moments of `turn_moments`. Since dE_k/dphi = i E_k+1, they give the Jacobian too, and as they
are smooth at 0 there is no special case for driving straight. (Models: Schubert, Richter and Wanielik, "Comparison
and evaluation of advanced motion models for vehicle tracking", FUSION 2008. DINO-CoDT, sec. III-F and IV-B, tracks
with CTRA, which it calls CYRA.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.tracking.motion import kalman
from coopsim.tracking.motion.constant_velocity import (
    MEASURED,
    YAW,
    Beliefs,
    Variances,
    check_parameters,
    diagonal,
    initial_beliefs,
    update_beliefs,
)
from coopsim.types import Tracks

SPEED, TURN_RATE, CLIMB, ACCELERATION = range(MEASURED, MEASURED + 4)

Complexes = NDArray[np.complex128]

_TERMS = np.arange(20)  # 1 / 20! is below rounding
_SERIES = np.array([[1 / (factorial(n) * (n + k + 1)) for k in range(3)] for n in _TERMS])


@dataclass(frozen=True, slots=True)
class ConstantTurnRate:
    """Constant turn rate and velocity (CTRV), with state x, y, z, l, w, h, yaw, speed, turn rate, climb.

    Of a measured heading only the axis is used, so a detector that confuses front and back does not turn a track. A
    half turn of the heading with the opposite sign of the speed is the same motion, so the motion decides which end is
    the front: a track that drives backwards faster than `reverse_speed_mps`, by two standard deviations, is turned
    around. That corrects a track that began with a wrong heading, and lets a car reverse slowly. A standing track
    keeps its first heading.

    Nothing moves sideways in this model, so its frame must not move with the observer: there a parked car moves
    sideways. The noise has the size that real detectors and traffic have, unlike that of `ConstantVelocity`.

    Attributes:
        initial_variance: variance of a first box whose detection states no covariance, m^2 and rad^2.
        initial_speed_variance: (m/s)^2, when a track begins.
        initial_turn_rate_variance: (rad/s)^2, when a track begins.
        initial_climb_variance: (m/s)^2, when a track begins.
        process_variance_per_s: growth of the variance of the box, per second.
        process_speed_variance_per_s: growth of the variance of speed, (m/s)^2 per second.
        process_turn_rate_variance_per_s: growth of the variance of turn rate, (rad/s)^2 per second.
        process_climb_variance_per_s: growth of the variance of climb, (m/s)^2 per second.
        measurement_variance: variance of a measurement whose detection states no covariance, m^2 and rad^2.
        reverse_speed_mps: largest speed backwards. Cars do reverse; people hardly walk backwards: for them 0.2 suits
            better, with less growth of the variance of speed.
    """

    initial_variance: Variances = (0.1, 0.1, 0.05, 0.1, 0.05, 0.05, 0.05)
    initial_speed_variance: float = 400.0
    initial_turn_rate_variance: float = 0.1
    initial_climb_variance: float = 0.25
    process_variance_per_s: Variances = (0.02, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01)
    process_speed_variance_per_s: float = 4.0
    process_turn_rate_variance_per_s: float = 0.1
    process_climb_variance_per_s: float = 0.1
    measurement_variance: Variances = (0.1, 0.1, 0.05, 0.1, 0.05, 0.05, 0.05)
    reverse_speed_mps: float = 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    def initiate(self, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return initial_beliefs(boxes, covariance, self.initial_variance, self._hidden_at_birth())

    def predict(self, beliefs: Beliefs, dt_s: float) -> Beliefs:
        if dt_s == 0:
            return beliefs
        mean, jacobian = advance(beliefs.mean, dt_s)
        mean[:, YAW] = wrap_angle(mean[:, YAW])
        # Noise enters all along the way. Half of it before the motion and half after is exact to second order in time;
        # all of it after would leave out the effect of a changing speed on the position.
        half = diagonal(self.process_variance_per_s, self._hidden_growth()) * (dt_s / 2)
        covariance = kalman.spread(beliefs.covariance + half, jacobian, half)
        return Beliefs(mean, (covariance + covariance.transpose(0, 2, 1)) / 2)

    def update(self, beliefs: Beliefs, boxes: Floats, covariance: Floats | None) -> Beliefs:
        return face_forwards(
            update_beliefs(beliefs, boxes, covariance, self.measurement_variance), self.reverse_speed_mps
        )

    def boxes(self, beliefs: Beliefs) -> Floats:
        return beliefs.mean[:, :MEASURED]

    def velocity(self, beliefs: Beliefs) -> Floats:
        yaw, speed = beliefs.mean[:, YAW], beliefs.mean[:, SPEED]
        return np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw)])

    def _hidden_at_birth(self) -> tuple[float, ...]:
        return self.initial_speed_variance, self.initial_turn_rate_variance, self.initial_climb_variance

    def _hidden_growth(self) -> tuple[float, ...]:
        return (
            self.process_speed_variance_per_s,
            self.process_turn_rate_variance_per_s,
            self.process_climb_variance_per_s,
        )


@dataclass(frozen=True, slots=True)
class ConstantTurnRateAcceleration(ConstantTurnRate):
    """Constant turn rate and acceleration (CTRA): `ConstantTurnRate` with acceleration as one more state.

    Attributes:
        process_speed_variance_per_s: small, because acceleration accounts for changes of speed.
        initial_acceleration_variance: (m/s^2)^2, when a track begins.
        process_acceleration_variance_per_s: growth of the variance of acceleration, (m/s^2)^2 per second.
    """

    process_speed_variance_per_s: float = 0.1
    initial_acceleration_variance: float = 1.0
    process_acceleration_variance_per_s: float = 4.0

    def _hidden_at_birth(self) -> tuple[float, ...]:
        return (*ConstantTurnRate._hidden_at_birth(self), self.initial_acceleration_variance)

    def _hidden_growth(self) -> tuple[float, ...]:
        return (*ConstantTurnRate._hidden_growth(self), self.process_acceleration_variance_per_s)


def advance(mean: Floats, dt_s: float) -> tuple[Floats, Floats]:
    """Return the states `dt_s` later (N, n) and their Jacobians (N, n, n), with n = 10 (CTRV) or 11 (CTRA).

    Yaw is not wrapped, so that the map is smooth.
    """
    size = mean.shape[1]
    accelerates = size > ACCELERATION
    speed, turn_rate = mean[:, SPEED], mean[:, TURN_RATE]
    acceleration = mean[:, ACCELERATION] if accelerates else np.zeros(len(mean))
    moments = turn_moments(turn_rate * dt_s)
    per_speed, per_acceleration, per_jerk = np.exp(1j * mean[:, YAW]) * moments * dt_s ** np.array([[1], [2], [3]])
    displacement = speed * per_speed + acceleration * per_acceleration

    moved = mean.copy()
    moved[:, 0] += displacement.real
    moved[:, 1] += displacement.imag
    moved[:, 2] += mean[:, CLIMB] * dt_s
    moved[:, YAW] += turn_rate * dt_s
    moved[:, SPEED] += acceleration * dt_s

    jacobian = np.broadcast_to(np.eye(size), (len(mean), size, size)).copy()
    by_turn_rate = 1j * (speed * per_acceleration + acceleration * per_jerk)
    columns = {YAW: 1j * displacement, SPEED: per_speed, TURN_RATE: by_turn_rate}
    if accelerates:
        columns[ACCELERATION] = per_acceleration
        jacobian[:, SPEED, ACCELERATION] = dt_s
    for column, derivative in columns.items():
        jacobian[:, 0, column], jacobian[:, 1, column] = derivative.real, derivative.imag
    jacobian[:, 2, CLIMB] = jacobian[:, YAW, TURN_RATE] = dt_s
    return moved, jacobian


def turn_moments(angle_rad: Floats) -> Complexes:
    """Return E_k = integral over s in [0, 1] of s^k exp(i angle s), for k = 0, 1, 2: (3, N).

    E_0 is (sin x / x) + i (1 - cos x) / x. Up to one radian by the Taylor series, beyond by recursion, which divides
    by the angle; both are exact to rounding, so there is no step where they meet.
    """
    small = np.abs(angle_rad) <= 1
    series = np.vander(1j * np.where(small, angle_rad, 0.0), len(_TERMS), increasing=True) @ _SERIES
    step = 1j * np.where(small, 1.0, angle_rad)
    turned = np.exp(step)
    zeroth = (turned - 1) / step
    first = (turned - zeroth) / step
    second = (turned - 2 * first) / step
    return np.where(small, series.T, np.stack([zeroth, first, second]))


def face_forwards(beliefs: Beliefs, reverse_speed_mps: float) -> Beliefs:
    """Turn around the objects that drive backwards faster than `reverse_speed_mps`, by two standard deviations.

    The heading turns by half a turn; speed, acceleration and their covariances with all else change sign. The motion
    is the same.
    """
    deviation = np.sqrt(beliefs.covariance[:, SPEED, SPEED])
    backwards = beliefs.mean[:, SPEED] + 2 * deviation < -reverse_speed_mps
    if not backwards.any():
        return beliefs
    signs = np.ones_like(beliefs.mean)
    signs[backwards, SPEED] = -1.0
    signs[backwards, ACCELERATION:] = -1.0
    mean = beliefs.mean * signs
    mean[backwards, YAW] = wrap_angle(mean[backwards, YAW] + np.pi)
    return Beliefs(mean, beliefs.covariance * signs[:, :, None] * signs[:, None, :])


MOVING_M_S = 2.0
"""What is faster faces where it goes."""


def face_velocity(tracks: Tracks) -> Tracks:
    """Return tracks, those that move (2 m/s) and face backwards turned around; others face as they did."""
    (x, y), yaw_rad = tracks.velocity.T, tracks.boxes.yaw
    backwards = (np.hypot(x, y) > MOVING_M_S) & (np.cos(yaw_rad) * x + np.sin(yaw_rad) * y < 0)
    faced_rad = np.where(backwards, wrap_angle(yaw_rad + np.pi), yaw_rad)
    return replace(tracks, boxes=replace(tracks.boxes, yaw=faced_rad))
