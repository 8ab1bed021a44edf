"""The reward of a car with a goal."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.envs.rewards import DriveStep, SafeProgress
from coopsim.support.checks import require_non_negative


@dataclass(frozen=True, kw_only=True)
class RouteReward(SafeProgress):
    """`SafeProgress`, and the ends of a drive: a second at the speed limit along the route is worth 1.

    Attributes:
        arrive: worth of reaching the goal, once; ours, as much as a crash costs.
        leave: cost of leaving the road or the route, once; MetaDrive's is that of a crash, too.
        red_light: cost of crossing a line at red; ours, half of a crash's. The way from a red light on is no progress.
    """

    arrive: float = 5.0
    leave: float = 5.0
    red_light: float = 2.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(arrive=self.arrive, leave=self.leave, red_light=self.red_light)

    def parts(self, step: DriveStep) -> dict[str, float]:
        """Return the parts of a step on the road: "progress", "comfort" and "crash"."""
        parts = SafeProgress.parts(self, step)
        if step.before.route.speed_limit_m_s[0] <= 0:
            parts["progress"] = min(parts["progress"], 0.0)
        return parts

    def events(self, *, arrives: bool, leaves: bool, red_light: bool) -> dict[str, float]:
        """Return the parts of what happened in a step: "arrive", "leave" and "red_light"."""
        return {
            "arrive": self.arrive * arrives,
            "leave": 0.0 - self.leave * leaves,
            "red_light": 0.0 - self.red_light * red_light,
        }
