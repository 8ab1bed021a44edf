"""Policies on boxes: AB3DMOT, late fusion, multi-sensor Kalman filters, and matching in four stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import TrackingPolicy, policy_row
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.fusion.pooling import MERGES, merge_duplicates, merge_matched, pool
from coopsim.support.checks import (
    require_choice,
    require_count,
    require_finite_number,
    require_probability,
    require_threshold,
)
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.cascade import AFFINITIES, four_stages, score_from
from coopsim.tracking.lifecycle import DecayingScore, HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections


@dataclass(kw_only=True, eq=False)
class AB3DMOTTracking(TrackingPolicy):
    """Base of policies that track with AB3DMOT (Weng et al., IROS 2020). Further parameters: `TrackingPolicy`.

    Attributes:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    gate: float = -0.2
    hits: int = 3
    age: int = 2

    def make_tracker(self) -> Tracker:
        return ab3dmot(self.gate, self.hits, self.age)


@policy_row("no_fusion", alias="ab3dmot")
class NoFusion(AB3DMOTTracking):
    """AB3DMOT on the agent's own detections, without messages: the lower bound that cooperation has to beat."""

    needs = Needs(uplink="none")
    method = "AB3DMOT (Weng et al., 2020) on the agent's own boxes"


@policy_row("sequential_kf")
class SequentialKF(AB3DMOTTracking):
    """Multi-sensor Kalman filter: the receiver's boxes update the tracks first, then each sender's in turn.

    The baseline of DMSTrack (Chiu et al., ICRA 2024) and of Graph Lap-CoMOT (Damanaki et al., 2025). A box that matches
    no track begins one, whichever agent it comes from. Parameters: `AB3DMOTTracking`.
    """

    method = "the multi-sensor Kalman filter that DMSTrack (Chiu et al., 2024) starts from, with fixed noise"


@policy_row("dmstrack")
class DMSTrack(AB3DMOTTracking):
    """`sequential_kf` with a learned covariance of each box (Chiu et al., "Probabilistic 3D Multi-Object Cooperative
    Tracking for Autonomous Driving via Differentiable Multi-Sensor Kalman Filter", ICRA 2024), positional variant.

    The noise of the motion is that with which the covariances were trained; with `covariance=None` the policy is
    `sequential_kf`. Parameters: `AB3DMOTTracking`.
    """

    method = "DMSTrack (Chiu et al., 2024), positional: covariances learned from boxes; none of its features"

    covariance: str | None = "dmstrack"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self._covariance is None:
            self.method = SequentialKF.method
        elif self._covariance.stated_by_detector:
            self.method = "DMSTrack (Chiu et al., 2024): covariances learned from what the detector's map shows"

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if spec.codec is None and self._covariance is not None and self._covariance.stated_by_detector:
            spec = replace(spec, codec="compact")  # which has room for covariances
        return super().make_uplink(spec, rng)

    def make_tracker(self) -> Tracker:
        motion = None if self._covariance is None else self._covariance.motion()
        return ab3dmot(self.gate, self.hits, self.age, motion=motion)


@dataclass(kw_only=True, eq=False)
class PooledBoxes(TrackingPolicy):
    """Base of policies that track the boxes of all agents at once, duplicates merged.

    Further parameters: `TrackingPolicy`.

    Attributes:
        merge_iou: BEV IoU from which two boxes of a class are the same object, in (0, 1].
        merge: replacement of duplicates: their score-weighted "mean", or the best-scored one alone, "nms", as in the
            papers' late fusion.
    """

    merge_iou: float = 0.15
    merge: str = "mean"

    def __post_init__(self) -> None:
        require_threshold(merge_iou=self.merge_iou)
        require_choice("merge", self.merge, MERGES)
        super().__post_init__()

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return [merge_duplicates(pool(groups), self.merge_iou, self.merge)]


@policy_row("late_fusion")
class LateFusion(PooledBoxes, AB3DMOTTracking):
    """AB3DMOT on the boxes of all agents, duplicates merged. Parameters: `PooledBoxes`, `AB3DMOTTracking`.

    The baseline of that name in the tables of V2V4Real (Xu et al., CVPR 2023) and DINO-CoDT (He et al., Table II).
    There a box is taken as if it were measured now, so that latency shows in full: `delayed="as_current"`.
    """

    method = "AB3DMOT (Weng et al., 2020) on the boxes of all agents"


@policy_row("hungarian")
class HungarianFusion(AB3DMOTTracking):
    """AB3DMOT on the boxes of all agents, matched pair by pair of agents and merged. Parameters: `AB3DMOTTracking`.

    The row "Hungarian" of Hu, Wang and Wang ("Integrated Detection and Tracking Framework for 3D Multi-Object Tracking
    in Vehicle-Infrastructure Cooperation"), Table I.

    Attributes:
        match_iou: smallest 3D IoU of two agents' boxes of one object, in (0, 1]; ours, the paper gives none.
    """

    method = "Hu et al.'s baseline Hungarian: boxes matched, fused, AB3DMOT"

    match_iou: float = 0.1

    def __post_init__(self) -> None:
        require_threshold(match_iou=self.match_iou)
        super().__post_init__()

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return [merge_matched(groups, self.match_iou)]


@policy_row("vic_fscm_association")
class VicFSCMAssociation(PooledBoxes):
    """Association by XIOU in four stages, FSCM (Hu, Wang and Wang, eq. 19-27): sure tracks and detections first.

    Only sure detections begin tracks. The paper's network predicts each track and its score (eq. 14-18); here a
    constant-velocity Kalman filter predicts the box. Further parameters: `PooledBoxes`.

    Attributes:
        detection_score: score from which a detection is sure (the paper's m_d).
        track_score: score from which a track is sure (m_t).
        score_decay: factor in [0, 1] on a track's score (s_t) for each frame without a detection; 1: it never falls.
            Ours: the paper's s_t is its network's score of the prediction.
        keep: frames for which a track without a detection is kept (N).
        affinity: similarity of boxes: "xiou", in which a half-turn error of the heading excludes a match;
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
