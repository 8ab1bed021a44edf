"""coop_fuse: coopsim's own tracker, the best that its parts gave on the V2V4Real training recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from coopsim.agents.tracking import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.checks import require_between, require_count, require_probability
from coopsim.fusion.calibration import Calibration
from coopsim.fusion.trust import Doubt, trust_likelier
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.assignment import hungarian
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.motion import ConstantVelocity
from coopsim.tracking.scoring import Likelihood
from coopsim.tracking.tracked import Tracked
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, Mask

MERGE_GATE, LEAST_CHANCE = 0.08, 0.05
DOUBT = Doubt(
    bias=-1.2977,
    own_score=-4.8722,
    other_score=0.8826,
    own_away=0.0607,
    other_away=-0.0311,
    gap=-0.2208,
    gap_away=0.0087,
)
CALIBRATION = Calibration(bias=-4.7102, score=9.0318, away=-0.037, volume=0.811, chance=1.9346)
LIKELIHOOD = Likelihood(bias=-3.7732, mean=4.4963, latest=4.0567)
"""Learned by `scripts/fit_coop_fuse.py` on the training recordings 0001 to 0031 of V2V4Real."""


@dataclass(frozen=True, slots=True)
class _SeenAgainOrSure:
    """Reported once seen again, or at once if the first detection is likely right; dropped by age."""

    hits: int
    sure: float
    age: int

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        return (tracks.hits >= self.hits) | (tracks.latest >= self.sure)

    def alive(self, tracks: Tracked) -> Mask:
        return tracks.misses < self.age


@POLICIES.register("coop_fuse")
class CoopFuse(TrackingPolicy):
    """Of several boxes on an object the likelier one weighs more; a track's score is how likely it is on an object.

    Which agent is right about a box (`Doubt`), how likely the box then is right (`Calibration`) and how likely a track
    is real (`Likelihood`) were learned from labels; the rest is AB3DMOT's.

    Args:
        merge_gate: smallest BEV GIoU of two agents' boxes on one object, in [-1, 1].
        least_chance: where two agents' heights exclude each other, how likely the less likely one must be to be
            tracked too, with the score that is left to it, in [0, 1]; 1: never.
        gate: smallest 3D GIoU of a track and a box, in [-1, 1].
        hits: frames with a detection until a track is reported.
        sure: how likely a first detection must be right to be reported at once, in [0, 1].
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
        doubt: which of two agents' boxes to believe.
        calibration: how likely a box is on an object.
        likelihood: how likely a track is on an object.
    """

    uplink = "detections"

    def __init__(
        self,
        merge_gate: float = MERGE_GATE,
        least_chance: float = LEAST_CHANCE,
        gate: float = -0.2,
        hits: int = 2,
        sure: float = 0.3,
        age: int = 2,
        late: str = "replay",
        align: bool = False,
        doubt: Doubt = DOUBT,
        calibration: Calibration = CALIBRATION,
        likelihood: Likelihood = LIKELIHOOD,
    ) -> None:
        require_between(-1, 1, merge_gate=merge_gate, gate=gate)
        require_probability(sure=sure, least_chance=least_chance)
        require_count(1, hits=hits, age=age)
        self._merge_gate, self._least_chance, self._doubt = merge_gate, least_chance, doubt
        self._calibration, self._likelihood = calibration, likelihood
        self._settings = (gate, hits, sure, age)
        super().__init__(late, align)

    def make_tracker(self) -> Tracker:
        gate, hits, sure, age = self._settings
        stages = Cascade([Stage(giou_3d, hungarian, gate)])
        return Tracker(ConstantVelocity(), stages, _SeenAgainOrSure(hits, sure, age), scoring=self._likelihood)

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        believed = trust_likelier(groups, self._merge_gate, self._doubt, self._least_chance)
        return [replace(believed.found, score=self._calibration.of(believed))]
