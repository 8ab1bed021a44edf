"""coop_fuse: coopsim's own tracker, the best that its parts gave on the V2V4Real training recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.agents.tracking import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.checks import require_between, require_count, require_probability
from coopsim.fusion.trust import trust_first
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.assignment import hungarian
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.motion import ConstantVelocity
from coopsim.tracking.scoring import ShrunkMean
from coopsim.tracking.tracked import Tracked
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, Mask


@dataclass(frozen=True, slots=True)
class _SeenAgainOrSure:
    """Reported once seen again, or at once if the first score is high; dropped by age."""

    hits: int
    sure: float
    age: int

    def reported(self, tracks: Tracked, frame: int) -> Mask:
        return (tracks.hits >= self.hits) | (tracks.score >= self.sure)

    def alive(self, tracks: Tracked) -> Mask:
        return tracks.misses < self.age


@POLICIES.register("coop_fuse")
class CoopFuse(TrackingPolicy):
    """The own box stands unless it is doubtful; a track is as sure as it was seen often and clearly.

    Boxes of several agents are not averaged (`trust_first`), a track's score is the mean over its life drawn to a low
    prior (`ShrunkMean`), and what is clear is reported at once. Settings were chosen on the training recordings 0001
    to 0031 of V2V4Real.

    Args:
        merge_gate: smallest BEV GIoU of two agents' boxes on one object, in [-1, 1].
        floor: score below which the own box gives way to a better one, in [0, 1].
        gate: smallest 3D GIoU of a track and a box, in [-1, 1].
        hits: frames with a detection until a track is reported.
        sure: score of a first detection with which it is reported at once, in [0, 1].
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
    """

    uplink = "detections"

    def __init__(
        self,
        merge_gate: float = 0.08,
        floor: float = 0.27,
        gate: float = -0.2,
        hits: int = 2,
        sure: float = 0.3,
        age: int = 2,
        late: str = "predict",
    ) -> None:
        require_between(-1, 1, merge_gate=merge_gate, gate=gate)
        require_probability(floor=floor, sure=sure)
        require_count(1, hits=hits, age=age)
        self._merge_gate, self._floor = merge_gate, floor
        self._settings = (gate, hits, sure, age)
        super().__init__(late)

    def make_tracker(self) -> Tracker:
        gate, hits, sure, age = self._settings
        scoring = ShrunkMean(prior=0.2, weight=10, coasting=0.5)
        lifecycle = _SeenAgainOrSure(hits, float(scoring.first(np.array(sure))), age)
        return Tracker(ConstantVelocity(), Cascade([Stage(giou_3d, hungarian, gate)]), lifecycle, scoring=scoring)

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return [trust_first(groups, self._merge_gate, self._floor)]
