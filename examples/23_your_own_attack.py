"""Plug in a custom attack with one method: it is given the honest detections, and returns those that are sent."""

from dataclasses import dataclass

import coopsim
from coopsim.attacks import ATTACKS
from coopsim.testing import check_attack
from coopsim.types import Detections


@ATTACKS.register("blind_spot")
@dataclass(kw_only=True)
class BlindSpot(coopsim.Attack):
    """Keep silent about everything near the agent itself."""

    near_m: float = 25.0

    def detect(self, view: coopsim.AttackerView, detections: Detections) -> Detections:
        near = (detections.boxes.center[:, :2] ** 2).sum(axis=1) < self.near_m**2
        view.deny(detections.boxes[near])
        return detections[~near]


check_attack("blind_spot")
for attacks in (None, "rsu_0=blind_spot", "rsu_0=ghost(ahead_m=15)"):
    score = coopsim.evaluate("late_fusion", "crossing", seed=1, max_cycles=50, lidar=None, attacks=attacks).score
    print(f"{attacks}: sAMOTA {score['sAMOTA']:.1f}, {score['FP']:.1f} false positives")
