"""Localization of an agent: a noisy global pose (`pose_noise`) and a drifting odometry.

Odometry has a small error in each step, and the errors add up, as those of wheel encoders and gyroscopes do. All errors
are drawn whatever their size, so that two runs that differ only in the size of the noise share its shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.config.load import load, read_mapping
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.localization.pose_noise import PoseCovariance, PoseError, PoseNoise
from coopsim.support.checks import require_instance, require_non_negative, require_positive
from coopsim.support.rng import stream
from coopsim.types import Odometry, PoseEstimate, stack_xyz_yaw


@dataclass(frozen=True, slots=True)
class LocalizationConfig:
    """Standard deviations of the localization's errors; all zero is perfect knowledge.

    Attributes:
        pose: errors of the global pose.
        odometry_noise_m: noise of x and of y of the motion, in each frame.
        odometry_heading_noise_rad: noise of the rotation, in each frame.
        odometry_scale: share by which all distances are overestimated, drawn once per episode.
        odometry_drift_rad_s: constant rate of rotation (a gyroscope's bias), drawn once per episode.
        covariance_scale: factor on the covariance that the agent states of its pose: 1 is honest, less is
            overconfident. None: it states no covariance.
    """

    pose: PoseNoise = field(default_factory=PoseNoise)
    odometry_noise_m: float = 0.005
    odometry_heading_noise_rad: float = 0.0002
    odometry_scale: float = 0.0
    odometry_drift_rad_s: float = 0.0
    covariance_scale: float | None = None

    def __post_init__(self) -> None:
        if self.pose is None:
            raise InvalidValueError("pose must be a coopsim PoseNoise, got None: leave it out for none")
        require_instance(PoseNoise, pose=self.pose)
        require_non_negative(
            odometry_noise_m=self.odometry_noise_m,
            odometry_heading_noise_rad=self.odometry_heading_noise_rad,
            odometry_scale=self.odometry_scale,
            odometry_drift_rad_s=self.odometry_drift_rad_s,
        )
        if self.covariance_scale is not None:
            require_positive(covariance_scale=self.covariance_scale)


def localization_config(
    given: LocalizationConfig | Mapping[str, Any] | str | Path,
) -> LocalizationConfig | Mapping[str, LocalizationConfig]:
    """Make a localization for all agents, or one by agent, from a mapping or the path of a YAML file with that.

    The mapping has the fields of `LocalizationConfig`, or agents, as `cav_0`, each with such a mapping.

    Raises:
        InvalidValueError: the file cannot be read, or a value is not accepted.
        UnknownNameError: there is no such field.
    """
    if isinstance(given, LocalizationConfig):
        return given
    mapping = read_mapping("localization", "a LocalizationConfig", given)
    if not mapping:
        raise InvalidValueError("localization has nothing in it: leave it out for the options that it replaces")
    config: LocalizationConfig | Mapping[str, LocalizationConfig] = load(
        LocalizationConfig | Mapping[str, LocalizationConfig], mapping, "localization"
    )
    return config


class Localizer:
    """Localization of one agent over one episode. Call `localize` once per frame, in order.

    Args:
        config: the size of the errors.
        seed: the episode's seed.
        agent: the agent's name, which owns the random streams.
        dt_s: time between two frames.
        stands: the agent is a roadside unit, whose odometry is exactly no motion.
    """

    def __init__(
        self, config: LocalizationConfig, seed: int, agent: str, dt_s: float = 0.1, *, stands: bool = False
    ) -> None:
        require_positive(dt_s=dt_s)
        self._pose_error = PoseError(config.pose, seed, agent, dt_s)
        self._odometry_rng = stream(seed, "odometry", agent)
        noise_m = config.odometry_noise_m
        self._step_sigma = np.array([noise_m, noise_m, 0.0, config.odometry_heading_noise_rad])
        scale, drift = stream(seed, "odometry bias", agent).standard_normal(2)
        self._scale = 1.0 + float(scale) * config.odometry_scale
        self._drift_rad = float(drift) * config.odometry_drift_rad_s * dt_s
        self._covariance_scale, self._covariance = config.covariance_scale or 0.0, None
        if config.covariance_scale is not None:
            drift_rad = config.odometry_drift_rad_s * dt_s
            sigma = self._step_sigma[[0, 1, 3]]
            self._covariance = PoseCovariance(config.pose, sigma, config.odometry_scale, drift_rad, dt_s)
        self._stands = stands
        self._previous: SE3 | None = None
        self._estimate: PoseEstimate | None = None

    def localize(self, world_SE3_base: SE3) -> tuple[PoseEstimate, Odometry]:
        """Return the estimates for a true pose; the first frame's odometry is no motion.

        During an outage the pose is the last one, moved by the odometry. An episode that begins with an outage begins
        with the true pose.
        """
        moves = self._previous is not None and not self._stands
        motion = self._measure(world_SE3_base)
        error, before = self._pose_error.step(), world_SE3_base
        if error is not None:
            pose = stack_xyz_yaw(world_SE3_base) + error
        else:
            before = world_SE3_base if self._estimate is None else self._estimate.world_SE3_base
            pose = stack_xyz_yaw(before.compose(SE3.from_xyz_yaw(motion[:3], float(motion[3]))))
        stated = None
        if self._covariance is not None:
            if error is not None:
                stated = self._covariance.received()
            else:
                stated = self._covariance.carried(before.yaw, motion, moves=moves)
            stated = stated * self._covariance_scale
        self._estimate = PoseEstimate(pose, stated)
        return self._estimate, Odometry(motion)

    def _measure(self, world_SE3_base: SE3) -> Floats:
        """Return the motion (4,) measured since the last frame, in that frame's base frame: x, y, z m, yaw rad."""
        error = self._odometry_rng.standard_normal(4) * self._step_sigma
        previous, self._previous = self._previous, world_SE3_base
        if previous is None or self._stands:
            return np.zeros(4)
        motion = stack_xyz_yaw(previous.inverse().compose(world_SE3_base))
        motion[:3] *= self._scale
        motion[3] += self._drift_rad
        motion += error
        return motion
