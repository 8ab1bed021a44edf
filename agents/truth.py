"""The policy that reports the true objects: the upper bound of every other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coopsim.agents.policy import Needs, Policy
from coopsim.catalog import POLICIES
from coopsim.errors import PolicyMismatchError
from coopsim.support.checks import require_flag, require_number
from coopsim.types import Observation, Tracks

_OWN = 0
"""Number in `GroundTruth.visible_to` of the objects that the agent itself sees."""


@POLICIES.register("truth")
@dataclass(kw_only=True, eq=False)
class Truth(Policy):
    """The true objects around each agent, with true velocities: perfect perception, and so an upper bound.

    It shows what a score, or a drive by a planner, would be worth without any error of perception. It is no competitor:
    tables mark it, leaderboards and `--isolate` refuse it.

    Attributes:
        range_m: distance from the agent's origin, on the ground, up to which objects are reported; infinite: all.
        occluded: report also objects of which the agent's own LiDAR has no return; without these the policy is the
            upper bound of an agent alone.
    """

    needs = Needs(uplink="none", truth=True)
    method = "upper bound, no competitor: it is told the true objects"

    range_m: float = math.inf
    occluded: bool = True

    def __post_init__(self) -> None:
        require_number("> 0 (inf: no limit)", lambda far: far > 0, range_m=self.range_m)
        require_flag(occluded=self.occluded)

    def track(self, agent: str, observation: Observation) -> Tracks:
        truth = observation.truth
        assert truth is not None  # `act` refuses infos without it
        if truth.velocity is None or (truth.visible_to is None and not self.occluded):
            raise PolicyMismatchError("truth needs true velocities, which recordings of detections in text files lack")
        there = np.hypot(*truth.boxes.center[:, :2].T) <= self.range_m
        if not self.occluded:
            there &= truth.visible_to == _OWN
        return Tracks(
            truth.id[there],
            truth.boxes[there],
            truth.velocity[there],
            np.ones(int(there.sum())),
            truth.label[there],
        )
