"""XIOU and four-stage cascade matching, FSCM (Hu, Wang and Wang, eq. 19-27), on boxes that agents share.

The association part of "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in
Vehicle-Infrastructure Cooperation". The paper's network predicts where each track is and how sure it is of that
(eq. 14-18); here a constant-velocity Kalman filter predicts the box, and the score falls while nothing is detected.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.catalog import POLICIES
from coopsim.support.checks import require_choice, require_count, require_finite_number, require_probability
from coopsim.tracking.cascade import AFFINITIES, four_stages, score_from
from coopsim.tracking.lifecycle import DecayingScore, HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker


@POLICIES.register("vic_fscm_association")
@dataclass(kw_only=True, eq=False)
class VicFSCMAssociation(PooledBoxes):
    """Association in four stages: sure tracks and sure detections first, doubtful ones among the rest.

    Only sure detections begin tracks. Further parameters: `PooledBoxes`.

    Attributes:
        detection_score: score from which a detection is sure (the paper's m_d).
        track_score: score from which a track is sure (m_t).
        score_decay: factor in [0, 1] on a track's score (s_t) for each frame without a detection; 1: it never falls.
            Ours: the paper's s_t is its network's score of the prediction.
        keep: frames for which a track without a detection is kept (N).
        affinity: by which boxes are matched: "xiou", in which a half-turn error of the heading excludes a match;
            "axial_xiou", for detectors that confuse front and back; or "giou", (GIoU + 1) / 2.
        gate: smallest affinity of a match, in [0, 1]; ours, the paper gives none.
        hits: frames with a detection, consecutive or not, until a track is reported; ours, the paper gives none.
    """

    method = "Hu et al.'s XIOU and four-stage matching (FSCM); not their network"

    detection_score: float = 0.5
    track_score: float = 0.4
    score_decay: float = 0.9
    keep: int = 20
    affinity: str = "xiou"
    gate: float = 0.4
    hits: int = 3

    def __post_init__(self) -> None:
        require_count(1, keep=self.keep)
        require_choice("affinity", self.affinity, AFFINITIES)
        require_probability(gate=self.gate, score_decay=self.score_decay)
        require_finite_number(detection_score=self.detection_score, track_score=self.track_score)
        super().__post_init__()

    def make_tracker(self) -> Tracker:
        return Tracker(
            ConstantVelocity(),
            four_stages(AFFINITIES[self.affinity], self.gate, self.track_score, self.detection_score),
            HitsAndAge(self.hits, self.keep, coast=1),
            scoring=DecayingScore(self.score_decay),
            initiator=score_from(self.detection_score),
        )
