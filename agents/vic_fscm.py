"""XIOU and four-stage cascade matching (Hu, Wang and Wang, eq. 19-27), on boxes that agents share.

The tracking part of "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure
Cooperation"; its learned detector is not part of this policy.
"""

from __future__ import annotations

from itertools import product

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.geometry.assignment import hungarian
from coopsim.support.checks import require_count, require_finite_number, require_probability
from coopsim.tracking.affinity.affinity import xiou
from coopsim.tracking.cascade import Cascade, Stage, score_below, score_from
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker


@POLICIES.register("vic_fscm")
class VicFSCM(PooledBoxes):
    """Sure tracks and sure detections first, doubtful ones among what is left, in four stages.

    A stage compares by XIOU, in which a half-turn error of the heading excludes a match: detectors must know front from
    back. Only sure detections begin tracks.

    Args:
        detection_score: score from which a detection is sure (the paper's m_d).
        track_score: score from which a track is sure (m_t).
        keep: frames for which a track without a detection is kept (N).
        gate: smallest XIOU of a match, in [0, 1]; the paper gives none.
        hits: frames with a detection until a track is reported.
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(
        self,
        detection_score: float = 0.5,
        track_score: float = 0.4,
        keep: int = 20,
        gate: float = 0.4,
        hits: int = 3,
        merge_iou: float = 0.15,
        late: str = "as_current",
        align: bool = False,
    ) -> None:
        require_count(1, keep=keep)
        require_probability(gate=gate)
        require_finite_number(detection_score=detection_score, track_score=track_score)
        self._settings = (detection_score, track_score, keep, gate, hits)
        super().__init__(merge_iou, late, align)

    def make_tracker(self) -> Tracker:
        detection_score, track_score, keep, gate, hits = self._settings
        sides = product(
            (score_from(track_score), score_below(track_score)),
            (score_from(detection_score), score_below(detection_score)),
        )
        stages = [Stage(xiou, hungarian, gate, tracks, found) for tracks, found in sides]
        lifecycle = HitsAndAge(hits, keep, coast=1)
        return Tracker(ConstantVelocity(), Cascade(stages), lifecycle, born=score_from(detection_score))
