"""coop_fuse, coopsim's own tracker, with weights learned for the detector whose boxes it fuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from coopsim.agents.tracking_policy import TrackingPolicy, policy_row
from coopsim.fusion.box_fusion import trust_likelier
from coopsim.fusion.fused_boxes import Calibration, SourceOdds
from coopsim.geometry.assignment import hungarian
from coopsim.support.checks import require_between, require_count, require_probability
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import ByScore, Likelihood
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections

MERGE_GATE, LEAST_CHANCE = 0.14, 0.02
DOUBT = SourceOdds(
    bias=-1.2997,
    own_score=-4.7583,
    other_score=0.8533,
    own_away=0.0586,
    other_away=-0.0301,
    gap=-0.2403,
    gap_away=0.0093,
)
HEARSAY = SourceOdds(
    bias=-3.0142,
    own_score=0.0,
    other_score=4.1407,
    own_away=0.0369,
    other_away=0.0047,
    gap=1.3243,
    gap_away=-0.0087,
)
CALIBRATION = Calibration(bias=-4.8248, score=10.4472, away=-0.0418, volume=0.7233, chance=0.7138)
LIKELIHOOD = Likelihood(bias=-3.2374, mean=3.9501, latest=4.0049, young=-1.2192, missed=-0.3319)
"""Learned by `scripts/fit_coop_fuse.py` on the training recordings 0001 to 0031 of V2V4Real."""


@dataclass(frozen=True, slots=True)
class Weights:
    """Parameters learned for the boxes of one detector; see the fields of these names in `CoopFuse`."""

    doubt: SourceOdds
    hearsay: SourceOdds
    calibration: Calibration
    likelihood: Likelihood
    least: float = 0.035


LEARNED: dict[str | None, Weights] = {
    None: Weights(DOUBT, HEARSAY, CALIBRATION, LIKELIHOOD),
    "pillars": Weights(
        SourceOdds(
            bias=0.0234,
            own_score=-13.503,
            other_score=13.5085,
            own_away=0.0139,
            other_away=-0.0146,
            gap=-0.1529,
            gap_away=0.0047,
        ),
        SourceOdds(
            bias=-0.4154,
            own_score=0.0,
            other_score=2.2014,
            own_away=0.0268,
            other_away=-0.0202,
            gap=4.5772,
            gap_away=0.0091,
        ),
        Calibration(bias=-11.0712, score=20.9587, away=0.0132, volume=0.3002, chance=0.9731),
        Likelihood(bias=-6.189, mean=12.9901, latest=4.6959, young=-0.7684, missed=-0.1428),
    ),
}
"""By `AgentSpec.calibration`; other detectors are taken for the first, PointPillars on V2V4Real.

Those of "pillars" were learned by the same script in the towns 100000 to 100003."""

MOTION = ConstantVelocity(process_variance_per_s=(10.0, 10.0, 10.0, 0.1, 0.1, 10.0, 0.1))
"""AB3DMOT's, with a length, a width and a heading that hardly change; a height does, where it is a compromise."""

_AFFINITY = replace(giou_3d, score_weight=0.6)
"""The 3D GIoU, less for a track and a box that are not equally likely on an object.

Of two boxes that exclude each other both are tracked, one above the other, and without this their tracks would change
places whenever the boxes do: then each has the score of both.
"""


@policy_row("coop_fuse")
class CoopFuse(TrackingPolicy):
    """AB3DMOT on fused boxes, which weigh by their likelihood; a track's score is its probability to be on an object.

    Which agent is right about a box (`SourceOdds`), how likely the box then is right (`Calibration`) and how likely a
    track is real (`Likelihood`) were learned from labels, for each of the detectors in `LEARNED`; the rest is
    AB3DMOT's. A parameter that is None is as learned for the detector of the running episode. Further parameters:
    `TrackingPolicy`, with `delayed="replay"` by default.

    Attributes:
        merge_gate: smallest BEV GIoU of two agents' boxes on one object, in [-1, 1].
        least_chance: smallest probability, in [0, 1], that an outweighed box is right although the fused one is not, at
            which the outweighed box is tracked, too, with its remaining score; 1: never.
        gate: smallest 3D GIoU of a track and an equally likely box, in [-1, 1].
        least: smallest probability of a reported track, in [0, 1].
        age: frames without a detection until a track is dropped.
        doubt: log odds that the other of two agents' boxes is right.
        hearsay: log odds of an object that the receiver does not detect, against registration's expectation.
        calibration: probability that a box is on an object.
        likelihood: probability that a track is on an object.
    """

    method = "coopsim's own tracker of fused boxes"

    delayed: str = "replay"
    merge_gate: float = MERGE_GATE
    least_chance: float = LEAST_CHANCE
    gate: float = -0.2
    least: float | None = None
    age: int = 3
    doubt: SourceOdds | None = None
    hearsay: SourceOdds | None = None
    calibration: Calibration | None = None
    likelihood: Likelihood | None = None

    def __post_init__(self) -> None:
        require_between(-1, 1, merge_gate=self.merge_gate, gate=self.gate)
        require_probability(least_chance=self.least_chance)
        if self.least is not None:
            require_probability(least=self.least)
        require_count(1, age=self.age)
        self._weights = self._weights_of(None)
        super().__post_init__()

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._weights = self._weights_of(spec.calibration)
        super().begin(spec, rng)

    def make_tracker(self) -> Tracker:
        stages = Cascade([Stage(_AFFINITY, hungarian, self.gate)])
        lifecycle = ByScore(self._weights.least, age=self.age, coast=self.age)
        return Tracker(MOTION, stages, lifecycle, scoring=self._weights.likelihood)

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        weights = self._weights
        fused = trust_likelier(groups, self.merge_gate, weights.doubt, weights.hearsay, self.least_chance)
        return [replace(fused.detections, score=weights.calibration.of(fused))]

    def _weights_of(self, detector: str | None) -> Weights:
        """Return the parameters that are given, and as learned for a detector those that are None."""
        given = {each.name: getattr(self, each.name) for each in fields(Weights)}
        return replace(LEARNED.get(detector, LEARNED[None]), **{k: v for k, v in given.items() if v is not None})
