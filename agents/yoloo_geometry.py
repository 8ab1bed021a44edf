"""The geometric half of YOLOO's association (Gu et al., eq. 8-9): the flexible geometric constraint, matched greedily.

The whole cost, with the learned similarity of point clouds, is that of `yoloo`.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.geometry.assignment import greedy
from coopsim.tracking.affinity import fgam
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker


@POLICIES.register("yoloo_geometry")
@dataclass(kw_only=True, eq=False)
class YolooGeometry(PooledBoxes):
    """Greedy matching by F-GAM: no pair farther apart than the smaller box's diagonal, and no gate to tune.

    Further parameters: `PooledBoxes`.

    Attributes:
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    method = "YOLOO (Gu et al.), its geometric constraint alone"

    hits: int = 3
    age: int = 2

    def make_tracker(self) -> Tracker:
        return Tracker(ConstantVelocity(), Cascade([Stage(fgam, greedy, gate=0.0)]), HitsAndAge(self.hits, self.age))
