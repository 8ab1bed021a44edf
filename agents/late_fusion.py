"""Late fusion: agents share boxes; each receiver pools them, merges duplicates and tracks the rest.

The baseline of that name in the tables of cooperative perception (V2V4Real, Xu et al., CVPR 2023; DINO-CoDT, He et al.,
Table II). There a box is taken as if it were measured now, so that latency shows in full: `delayed="as_current"`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from coopsim.agents.ab3dmot_policy import AB3DMOTTracking
from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.fusion.pooling import MERGES, merge_duplicates, pool
from coopsim.support.checks import require_choice, require_threshold
from coopsim.types import Detections


@dataclass(kw_only=True, eq=False)
class PooledBoxes(TrackingPolicy):
    """A policy that tracks the boxes of all agents at once, duplicates merged. Further parameters: `TrackingPolicy`.

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


@POLICIES.register("late_fusion")
@dataclass(kw_only=True, eq=False)
class LateFusion(PooledBoxes, AB3DMOTTracking):
    """AB3DMOT on the boxes of all agents, duplicates merged. Parameters: `PooledBoxes`, `AB3DMOTTracking`."""

    method = "AB3DMOT (Weng et al., 2020) on the boxes of all agents"
