"""Covariance of x, y and heading that an agent states of its pose, by the sizes of its errors."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.localization.pose_noise import PoseNoise


class PoseCovariance:
    """The covariance of one agent's pose error over one episode. Call one method once per frame, in order.

    With reception it is the prior covariance of the error's parts. During an outage it is propagated to first order
    through the composition of pose and measured motion (Smith, Self and Cheeseman 1990), in which the odometry's
    constant errors add up coherently and its noise does not.

    Args:
        noise: of the global pose.
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
        """Return the covariance (3, 3) of a pose that odometry carried on in this frame.

        Args:
            yaw_rad: heading before the motion.
            motion: (4,) measured: x, y, z m, yaw rad.
            moves: False for an agent that is known to stand.
        """
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
