"""The tracking side of DINO-CoDT (He et al., sec. III-F to III-H): rules by class, re-identification, age by speed.

Its detector is not part of this policy, nor is what makes embeddings: any detector may give them, the paper's are
DINOv2's. Without them, boxes alone decide.
"""

from __future__ import annotations

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.geometry.assignment import Assigner, greedy, hungarian
from coopsim.support.checks import require_instance, require_threshold
from coopsim.tracking.affinity.affinity import iou_3d
from coopsim.tracking.affinity.appearance import Appearance
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import Remembered, VelocityAdaptiveAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity, Motion
from coopsim.tracking.motion.turning import ConstantTurnRateAcceleration
from coopsim.tracking.tracker import Tracker
from coopsim.types.taxonomy import Superclass

NIMBLE = Superclass.PEDESTRIAN.classes
"""Classes that turn as they like: people, on foot or on two wheels."""


@POLICIES.register("dino_codt")
class DinoCoDT(PooledBoxes):
    """Vehicles by constant velocity, Hungarian; people and two-wheelers by constant turn rate and acceleration, greedy.

    What their boxes do not match is matched by embeddings, where detections have them. The paper assigns the motion
    models to classes twice, and differently; this is its section III-F.

    Args:
        gate: smallest 3D IoU of a match, in (0, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until the track of something that stands is dropped (A_c).
        age_per_m_s: frames more per m/s (alpha).
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
        appearance: how embeddings are used; None: with the defaults.
    """

    def __init__(
        self,
        gate: float = 0.01,
        hits: int = 3,
        age: int = 2,
        age_per_m_s: float = 0.2,
        merge_iou: float = 0.15,
        late: str = "as_current",
        align: bool = False,
        appearance: Appearance | None = None,
    ) -> None:
        require_threshold(gate=gate)
        require_instance(Appearance, appearance=appearance)
        self._gate, self._appearance = gate, appearance or Appearance()
        self._lifecycle = Remembered(VelocityAdaptiveAge(hits, age, age_per_m_s), hits, self._appearance.frames)
        super().__init__(merge_iou, late, align)

    def make_tracker(self) -> TrackersByClass:
        turning = ConstantTurnRateAcceleration(reverse_speed_mps=0.2)  # nobody walks backwards faster
        vehicles, nimble = self._tracker(ConstantVelocity(), hungarian), self._tracker(turning, greedy)
        return TrackersByClass(vehicles, {NIMBLE: nimble})

    def _tracker(self, motion: Motion, assigner: Assigner) -> Tracker:
        by_boxes = Stage(iou_3d, assigner, self._gate, tracks=self._lifecycle.in_sight)
        stages = Cascade([by_boxes, self._appearance.stage()])
        return Tracker(motion, stages, self._lifecycle, appearance=self._appearance)
