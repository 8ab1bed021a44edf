"""Plug in a custom defence with one method: it sees what its receiver has and is told, and says whom to believe."""

import numpy as np

import coopsim
from coopsim.defenses import DEFENSES
from coopsim.testing import check_defense


@DEFENSES.register("agreeing")
class Agreeing(coopsim.Defense):
    """Believe a sender if of its objects near the receiver at least half are where the receiver detects one."""

    def judge(self, reception: coopsim.Reception) -> coopsim.Trust:
        own, trust = reception.own.boxes.center[:, :2], {}
        for claim in reception.claims:
            center = claim.detections.boxes.center[:, :2]
            near = center[np.hypot(*center.T) < 20.0]
            apart_m = np.linalg.norm(near[:, None] - own, axis=2).min(axis=1, initial=np.inf)
            trust[claim.sender] = float(np.mean(apart_m < 2.0)) if len(near) else 1.0
        return coopsim.Trust(trust)


check_defense("agreeing")
for policy in ("late_fusion", "late_fusion(defense=agreeing)", "late_fusion(defense=plausibility)"):
    result = coopsim.evaluate(policy, "crossing", seed=1, max_cycles=60, lidar=None)
    print(f"{policy}: sAMOTA {result.score['sAMOTA']:.1f}, {result.counts.get('messages not believed', 0)} left out")
