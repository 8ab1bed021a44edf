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
    """

    arrive: float = 5.0
    leave: float = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(arrive=self.arrive, leave=self.leave)

    def parts(self, step: DriveStep) -> dict[str, float]:
        """Return the parts of a step on the road: "progress", "comfort", "crash", and "arrive" where the goal is."""
        return SafeProgress.parts(self, step)

    def ends(self, *, arrives: bool, leaves: bool) -> dict[str, float]:
        """Return the parts of a drive's end."""
        return {"arrive": self.arrive * arrives, "leave": 0.0 - self.leave * leaves}
