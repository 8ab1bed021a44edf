"""YOLOO (Gu et al., "YOLOO: You Only Learn from Others Once"): objects are known again by their points and places.

The paper tracks what one agent sees; here all agents' boxes are pooled, and their looks are sent along.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from coopsim.agents.described_boxes import DescribedBoxes
from coopsim.agents.policy import Needs
from coopsim.agents.yoloo_geometry import YolooGeometry
from coopsim.catalog import POLICIES
from coopsim.geometry.assignment import greedy
from coopsim.support.checks import require_flag
from coopsim.tracking.appearance import LastEmbedding, YolooAffinity
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder

_WITH_LOOKS, _WITHOUT = "pairs compared by looks and geometry", "pairs compared by geometry alone"
"""Names of what is counted."""


@POLICIES.register("yoloo")
@dataclass(kw_only=True, eq=False)
class Yoloo(DescribedBoxes, YolooGeometry):
    """Greedy matching by the sum of two costs: unlike looks and distance (eq. 9). Further parameters: `YolooGeometry`.

    Each agent embeds its own detections by the points in them, unless the environment's detector or embedder does, and
    sends the vectors along. A pair without them, because of few points, a LiDAR that is missing, or a sender whose
    vectors are of another length, is compared by geometry alone; `counts` says how many were.

    Attributes:
        appearance: use looks; without, this is `yoloo_geometry`.
        weights: of the encoder of points, by name or as the path of a file.
    """

    needs = Needs(lidar=True)

    appearance: bool = True
    weights: str = "point_identity"

    def __post_init__(self) -> None:
        require_flag(appearance=self.appearance)
        self.needs = Needs()  # an agent without a LiDAR takes part: geometry decides for it
        if self.appearance:
            self.method = "YOLOO (Gu et al.): looks of points and geometry, of all agents; looks learned without CLIP"
        super().__post_init__()

    def make_embedder(self) -> Embedder | None:
        if not self.appearance:
            return None
        from coopsim.detection.point_identity import PointIdentity

        return PointIdentity(self.weights)

    def make_tracker(self) -> Tracker:
        if self._embed is None:
            return super().make_tracker()
        cost = Stage(YolooAffinity(self._count), greedy, gate=0.0)
        return Tracker(ConstantVelocity(), Cascade([cost]), HitsAndAge(self.hits, self.age), appearance=LastEmbedding())

    def _count(self, with_looks: int, without: int) -> None:
        self.counts[_WITH_LOOKS] += with_looks
        self.counts[_WITHOUT] += without
