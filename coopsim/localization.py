"""Where an agent believes it is: a noisy global pose and a drifting odometry.

The global pose errs independently in each frame, as the cooperative-perception papers assume (V2X-ViT,
Xu et al. 2022, sec. 5: Gaussian noise on position and heading). Odometry errs a little in each step, and the
errors add up, as wheel encoders and gyroscopes do. Both errors are drawn whatever their size, so that two
runs that differ only in how large the noise is share its shape.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from coopsim.checks import require_non_negative
from coopsim.geometry.se3 import SE3
from coopsim.rng import stream
from coopsim.types import Odometry, PoseEstimate, stack_xyz_yaw


@dataclass(frozen=True, slots=True)
class LocalizationConfig:
    """Standard deviations of the localization's errors; all zero is perfect knowledge.

    Attributes:
        position_noise_m: of x and of y of the global pose, in each frame.
        heading_noise_rad: of the global heading, in each frame.
        odometry_noise_m: of x and of y of the motion, in each frame.
        odometry_heading_noise_rad: of the turn, in each frame.
    """

    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    odometry_noise_m: float = 0.005
    odometry_heading_noise_rad: float = 0.0002

    def __post_init__(self) -> None:
        require_non_negative(**asdict(self))


class Localizer:
    """One agent's localization over one episode. It must be asked once in each frame, in order.

    Args:
        config: the size of the errors.
        seed: the episode's seed.
        agent: the agent's name, which owns the random streams.
        stands: a roadside unit, which is surveyed once: its odometry is exactly "did not move".
    """

    def __init__(self, config: LocalizationConfig, seed: int, agent: str, *, stands: bool = False) -> None:
        across_m, turn_rad = config.odometry_noise_m, config.odometry_heading_noise_rad
        self._pose_sigma = np.array([config.position_noise_m, config.position_noise_m, 0.0, config.heading_noise_rad])
        self._step_sigma = np.array([across_m, across_m, 0.0, turn_rad])
        self._pose_rng = stream(seed, "pose", agent)
        self._odometry_rng = stream(seed, "odometry", agent)
        self._stands = stands
        self._previous: SE3 | None = None

    def localize(self, world_SE3_base: SE3) -> tuple[PoseEstimate, Odometry]:
        """The estimates for a true pose; the first frame's odometry is no motion."""
        pose = stack_xyz_yaw(world_SE3_base) + self._pose_rng.standard_normal(4) * self._pose_sigma
        error = self._odometry_rng.standard_normal(4) * self._step_sigma
        if self._previous is None or self._stands:
            motion = np.zeros(4)
        else:
            motion = stack_xyz_yaw(self._previous.inverse().compose(world_SE3_base)) + error
        self._previous = world_SE3_base
        return PoseEstimate(pose), Odometry(motion)
