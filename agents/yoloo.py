"""The tracking side of YOLOO (Gu et al., eq. 8-9): the flexible geometric constraint and greedy matching.

The learned similarity of point clouds, the other half of its cost, is not part of this policy.
"""

from __future__ import annotations

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.geometry.assignment import greedy
from coopsim.tracking.affinity.affinity import fgam
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker


@POLICIES.register("yoloo")
class Yoloo(PooledBoxes):
    """Greedy by F-GAM: nothing farther than a box's own diagonal matches, and no gate needs tuning.

    Args:
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(
        self, hits: int = 3, age: int = 2, merge_iou: float = 0.15, late: str = "as_current", align: bool = False
    ) -> None:
        self._settings = (hits, age)
        super().__init__(merge_iou, late, align)

    def make_tracker(self) -> Tracker:
        return Tracker(ConstantVelocity(), Cascade([Stage(fgam, greedy, gate=0.0)]), HitsAndAge(*self._settings))
