"""Rewards by name: of the tracks that an agent reports, of how its car drives, or of what others gain by hearing it."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, ClassVar

import numpy as np

from coopsim.catalog import REWARDS
from coopsim.config.spec import instantiate, parse_spec
from coopsim.envs.message_gain import MessageGain
from coopsim.errors import InvalidValueError, RewardWarning
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import FrameCounts
from coopsim.support.checks import require_non_negative
from coopsim.support.methods import is_newer
from coopsim.types.driving import CarState


class Reward(ABC):
    """A rule that turns one frame's counts into one agent's reward."""

    @abstractmethod
    def __call__(self, counts: FrameCounts) -> float:
        """Return the reward for a frame with these counts."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveStep:
    """Step of a driven car.

    Attributes:
        counts: counts of the tracks that were reported before the step.
        dt_s: duration of the step.
        before: state of the car before the step.
        after: state of the car after the step.
        moved_m: (2,) place of the car after the step, in its base frame before it.
    """

    counts: FrameCounts
    dt_s: float
    before: CarState
    after: CarState
    moved_m: Floats

    @property
    def progress_m(self) -> float:
        """Distance along the route."""
        along, _, _ = self.before.route.place(np.stack([np.zeros(2), self.moved_m]))
        return float(along[1] - along[0])

    @property
    def jerk_m_s3(self) -> float:
        """Change of the acceleration in a second."""
        return (self.after.acceleration_m_s2 - self.before.acceleration_m_s2) / self.dt_s

    @property
    def crashes(self) -> bool:
        """True in the step in which the car crashes."""
        return self.after.crashed and not self.before.crashed


class DriveReward(ABC):
    """A rule that turns one step of a driven car into its agent's reward. Agents that do not drive get 0.

    A class may name the parts of which its reward is the sum. A subclass of it that overrides `__call__` alone is asked
    for the whole.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if is_newer(cls, "__call__", "parts"):
            cls.parts = DriveReward.parts  # type: ignore[method-assign]

    @abstractmethod
    def __call__(self, step: DriveStep) -> float:
        """Return the reward for this step."""

    def parts(self, step: DriveStep) -> dict[str, float]:
        """Return the reward's parts by name, whose sum is the reward. By default there is one, `WHOLE`."""
        return {WHOLE: self(step)}


WHOLE = "reward"
"""Name of the only part of a reward without parts."""


def total(parts: Mapping[str, float]) -> float:
    """Return the sum of a reward's parts in their order, the same bits with every Python; 0 without parts."""
    return reduce(add, parts.values()) if parts else 0.0


AnyReward = Reward | DriveReward | MessageGain

RewardOption = str | AnyReward | None
"""Reward by name, also with parameters, such as "safe_progress(crash=10)", an object, or None: "mota"."""


@REWARDS.register("mota")
class MotaReward(Reward):
    """The frame's own MOTA as a reward: 1 - (FP + FN + IDSW) / GT, clipped at -1.

    A frame without ground truth gives 1 if nothing is reported, else the clipped value for GT = 1.
    """

    def __call__(self, counts: FrameCounts) -> float:
        """Return the frame's MOTA."""
        errors = counts.fp + counts.fn + counts.idsw
        return max(-1.0, 1.0 - errors / max(counts.gt, 1))


@REWARDS.register("safe_progress")
@dataclass(frozen=True, kw_only=True)
class SafeProgress(DriveReward):
    """Progress, less discomfort and crashes; a second at the speed limit is worth 1, for any `dt_s`.

    reward = progress - `comfort` * discomfort * dt - `crash` (in the step of the crash)

    Progress is the distance along the route over the speed limit: the seconds that a free drive would take. It is at
    most dt, so speeding earns nothing. Discomfort is the mean of two squares, of acceleration and of jerk, each over
    its bound of comfort and at most 1.

    Attributes:
        crash: cost of a crash. A crash costs as much as 5 s at full speed in `highway_env`'s intersection
            (`collision_reward` -5, `high_speed_reward` 1, a step a second).
        comfort: cost of a second in full discomfort. NAVSIM (Dauner et al., NeurIPS 2024) weights comfort by 2 and
            progress by 5.
    """

    MOST_M_S2: ClassVar[float] = 2.40
    LEAST_M_S2: ClassVar[float] = -4.05
    MOST_JERK_M_S3: ClassVar[float] = 4.13
    """Bounds of comfort along the lane by nuPlan (Caesar et al., 2021), which NAVSIM takes over."""

    crash: float = 5.0
    comfort: float = 2 / 5

    def __post_init__(self) -> None:
        require_non_negative(crash=self.crash, comfort=self.comfort)

    def __call__(self, step: DriveStep) -> float:
        """Return the reward for this step."""
        return total(SafeProgress.parts(self, step))

    def parts(self, step: DriveStep) -> dict[str, float]:
        """Return the reward's parts: "progress" (s), "comfort" and "crash", of which the latter two are at most 0."""
        limit_m_s = max(float(step.before.route.speed_limit_m_s[0]), 0.1)
        return {
            "progress": min(step.progress_m / limit_m_s, step.dt_s),
            "comfort": 0.0 - self.comfort * self._discomfort(step) * step.dt_s,
            "crash": 0.0 - self.crash * step.crashes,
        }

    def _discomfort(self, step: DriveStep) -> float:
        """Return the discomfort of a step, in [0, 1]."""
        acceleration = step.after.acceleration_m_s2
        bound = self.MOST_M_S2 if acceleration > 0 else self.LEAST_M_S2
        shares = (acceleration / bound, step.jerk_m_s3 / self.MOST_JERK_M_S3)
        return sum(min(share**2, 1.0) for share in shares) / len(shares)


def warn_of_tracking_reward() -> None:
    """Warn that a driver whose tracks a policy reports has no influence on the default reward. Python shows it once."""
    warnings.warn(
        'the default reward is "mota": it scores tracks, which the tracker reports, so a driver learns nothing by it; '
        'choose reward="safe_progress", or reward="mota" where this is meant',
        RewardWarning,
        stacklevel=2,
    )


def make_reward(reward: RewardOption) -> AnyReward:
    """Make the option `reward`.

    Raises:
        UnknownNameError: there is no such reward, or no such parameter.
        InvalidValueError: it is no reward, or a parameter's value is not accepted.
    """
    made: object = MotaReward() if reward is None else reward
    if isinstance(made, str):
        name, parameters = parse_spec("reward", made)
        made = instantiate("reward", name, REWARDS.get(name), parameters)
    if not isinstance(made, AnyReward):
        is_class = isinstance(made, type) and issubclass(made, AnyReward)
        hint = f": write {made.__name__}()" if isinstance(made, type) and is_class else ""
        raise InvalidValueError(
            f"reward must be a coopsim Reward, DriveReward or MessageGain, a name or None, got {made!r}{hint}"
        )
    return made
