"""The tracking side of DINO-CoDT (He et al., sec. III-F to III-H): rules by class, and a maximum age by speed.

Its detector and the re-identification by DINOv2 embeddings come later; until then this is the geometric part alone.
"""

from __future__ import annotations

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.checks import require_threshold
from coopsim.taxonomy import Superclass
from coopsim.tracking.affinity import iou_3d
from coopsim.tracking.assignment import greedy, hungarian
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import VelocityAdaptiveAge
from coopsim.tracking.motion import ConstantVelocity
from coopsim.tracking.tracker import Tracker
from coopsim.tracking.turning import ConstantTurnRateAcceleration

NIMBLE = Superclass.PEDESTRIAN.classes
"""Classes that turn as they like: people, on foot or on two wheels."""


@POLICIES.register("dino_codt")
class DinoCoDT(PooledBoxes):
    """Vehicles by constant velocity, Hungarian; people and two-wheelers by constant turn rate and acceleration, greedy.

    The paper assigns the motion models to classes twice, and differently; this is its section III-F.

    Args:
        gate: smallest 3D IoU of a match, in (0, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until the track of something that stands is dropped (A_c).
        age_per_m_s: frames more per m/s (alpha).
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        late: what to do with messages that come late, see `TrackingPolicy`.
    """

    def __init__(
        self,
        gate: float = 0.01,
        hits: int = 3,
        age: int = 2,
        age_per_m_s: float = 0.2,
        merge_iou: float = 0.15,
        late: str = "as_current",
    ) -> None:
        require_threshold(gate=gate)
        self._gate, self._lifecycle = gate, VelocityAdaptiveAge(hits, age, age_per_m_s)
        super().__init__(merge_iou, late)

    def make_tracker(self) -> TrackersByClass:
        vehicles = Tracker(ConstantVelocity(), Cascade([Stage(iou_3d, hungarian, self._gate)]), self._lifecycle)
        turning = ConstantTurnRateAcceleration(reverse_speed_mps=0.2)  # nobody walks backwards faster
        nimble = Tracker(turning, Cascade([Stage(iou_3d, greedy, self._gate)]), self._lifecycle)
        return TrackersByClass(vehicles, {NIMBLE: nimble})
