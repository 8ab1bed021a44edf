"""Errors of one agent's global pose over an episode.

White noise is the protocol of the cooperative-perception papers (V2X-ViT, Xu et al. 2022, sec. 5: Gaussian noise on
position and heading). Errors of a satellite receiver are not white: they wander (an Ornstein-Uhlenbeck process), have a
constant part, jump when reflections come and go, and there are outages without a signal.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import ndtr

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_non_negative
from coopsim.support.rng import stream


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """Standard deviations and times of the global pose's errors; the default has no errors.

    Attributes:
        position_noise_m: noise of x and of y.
        heading_noise_rad: noise of the heading.
        distribution: distribution of both, "gaussian" or "laplace" (longer tails, with the same standard deviation).
        correlation_s: time over which the correlation of both falls to 1/e; 0: they are white.
        position_bias_m: constant part of x and of y, drawn once per episode.
        heading_bias_rad: constant part of the heading, drawn once per episode.
        jump_m: offset of x and of y, which is 0 at first and drawn anew at each jump.
        jumps_per_s: mean number of jumps per second.
        outage_s: mean duration of an outage, in which odometry carries the pose on.
        outages_per_s: mean number of outages that begin, per second of reception.
    """

    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    distribution: Literal["gaussian", "laplace"] = "gaussian"
    correlation_s: float = 0.0
    position_bias_m: float = 0.0
    heading_bias_rad: float = 0.0
    jump_m: float = 0.0
    jumps_per_s: float = 0.0
    outage_s: float = 0.0
    outages_per_s: float = 0.0

    def __post_init__(self) -> None:
        require_choice("distribution", self.distribution, ("gaussian", "laplace"))
        numbers: dict[str, Any] = asdict(self)
        del numbers["distribution"]
        require_non_negative(**numbers)
        for size, rate in (("jump_m", "jumps_per_s"), ("outage_s", "outages_per_s")):
            if (numbers[size] > 0) != (numbers[rate] > 0):
                raise InvalidValueError(
                    f"{size} and {rate} must be both 0 or both > 0, got {numbers[size]!r} and {numbers[rate]!r}"
                )


class PoseError:
    """Errors of one agent's pose over one episode. Call `step` once per frame, in order.

    Every part has its own stream, named by the agent, and takes the same draws whatever its size (a part that never
    comes takes none): runs that differ only in the size of the noise share its shape.
    """

    def __init__(self, noise: PoseNoise, seed: int, agent: str, dt_s: float) -> None:
        self._noise, self._dt_s = noise, dt_s
        self._white, self._jumps, self._outages = (
            stream(seed, purpose, agent) for purpose in ("pose", "pose jumps", "pose outages")
        )
        bias = [noise.position_bias_m, noise.position_bias_m, 0.0, noise.heading_bias_rad]
        self._bias = stream(seed, "pose bias", agent).standard_normal(4) * bias
        self._sigma = np.array([noise.position_noise_m, noise.position_noise_m, 0.0, noise.heading_noise_rad])
        self._normal: Floats | None = None
        self._offset = np.zeros(4)
        self._in_outage = False

    def step(self) -> Floats | None:
        """Return this frame's error (4,) of x, y, z m and heading rad in the world frame; None during an outage."""
        error = self._shape(self._correlated()) * self._sigma
        self._jump()
        self._lose_or_find()
        return None if self._in_outage else error + self._bias + self._offset

    def _correlated(self) -> Floats:
        """Return standard normal numbers (4,), an Ornstein-Uhlenbeck process sampled in frames."""
        fresh = self._white.standard_normal(4)
        if self._normal is None or not self._noise.correlation_s:
            self._normal = fresh
        else:
            kept = math.exp(-self._dt_s / self._noise.correlation_s)
            self._normal = kept * self._normal + math.sqrt(1 - kept**2) * fresh
        return self._normal

    def _shape(self, normal: Floats) -> Floats:
        """Convert normal numbers to the distribution, with unit variance and the same ranks."""
        if self._noise.distribution == "gaussian":
            return normal
        tail = 2 * ndtr(-np.abs(normal))  # tail probability, whose logarithm is a Laplace quantile
        laplace: Floats = -np.sign(normal) * np.log(tail) / math.sqrt(2)
        return laplace

    def _jump(self) -> None:
        if not self._noise.jumps_per_s:
            return
        due, offset = self._jumps.random(), self._jumps.standard_normal(2)
        if due < self._probability(self._noise.jumps_per_s):
            self._offset = np.array([*offset * self._noise.jump_m, 0.0, 0.0])

    def _lose_or_find(self) -> None:
        """Go between reception and outage: states of a Markov chain whose durations are exponential."""
        if not self._noise.outages_per_s:
            return
        leave_per_s = 1 / self._noise.outage_s if self._in_outage else self._noise.outages_per_s
        if self._outages.random() < self._probability(leave_per_s):
            self._in_outage = not self._in_outage

    def _probability(self, per_s: float) -> float:
        """Return the probability of at least one event in a frame, for a Poisson process of `per_s` events a second."""
        return -math.expm1(-per_s * self._dt_s)


class PoseCovariance:
    """Covariance (3, 3) of x, y and heading that an agent states over one episode. Call one method once per frame.

    With reception it is the prior covariance of the error's parts. During an outage it is propagated to first order
    through the composition of pose and measured motion (Smith, Self and Cheeseman 1990), in which the odometry's
    constant errors add up coherently and its noise does not.

    Args:
        noise: errors of the global pose.
        odometry_sigma: (3,) standard deviations of the motion's noise in a frame: x, y m and yaw rad.
        scale: standard deviation of the odometry's scale.
        drift_rad: standard deviation of the odometry's constant rotation in a frame.
        dt_s: time between two frames.
    """

    def __init__(self, noise: PoseNoise, odometry_sigma: Floats, scale: float, drift_rad: float, dt_s: float) -> None:
        self._noise, self._dt_s = noise, dt_s
        self._step = np.diag(np.square(odometry_sigma))
        self._constant = np.square([scale, drift_rad])
        self._frames = 0
        self._random = np.zeros((3, 3))
        self._by_constant = np.zeros((3, 2))  # derivative of the pose by scale and drift

    def received(self) -> Floats:
        """Return the covariance (3, 3) of a pose that was received in this frame."""
        noise = self._noise
        self._frames += 1
        jumped = -math.expm1(-noise.jumps_per_s * self._dt_s * self._frames)
        position = noise.position_noise_m**2 + noise.position_bias_m**2 + noise.jump_m**2 * jumped
        heading = noise.heading_noise_rad**2 + noise.heading_bias_rad**2
        self._random, self._by_constant = np.diag([position, position, heading]), np.zeros((3, 2))
        return self._random

    def carried(self, yaw_rad: float, motion: Floats, *, moves: bool) -> Floats:
        """Return the covariance (3, 3) of a pose that odometry carried on from a heading by a measured motion (4,)."""
        self._frames += 1
        if moves:
            cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
            turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            along = turn @ [motion[0], motion[1], 0.0]
            by_pose = np.eye(3)
            by_pose[:2, 2] = -along[1], along[0]
            self._random = by_pose @ self._random @ by_pose.T + turn @ self._step @ turn.T
            self._by_constant = by_pose @ self._by_constant + np.column_stack([along, [0.0, 0.0, 1.0]])
        return self._random + (self._by_constant * self._constant) @ self._by_constant.T
