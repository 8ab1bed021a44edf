"""Late fusion: agents share boxes; each receiver pools them, merges duplicates, and tracks the rest.

The baseline of that name in the tables of cooperative perception (V2V4Real, Xu et al., CVPR 2023; DINO-CoDT, He et al.,
Table II). With `late="as_current"` a box is taken as if it were measured now: pose noise and latency show in full.
"""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.fusion.pooling import merge_duplicates, pool
from coopsim.support.checks import require_threshold
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections


class PooledBoxes(TrackingPolicy):
    """A policy that tracks all agents' boxes at once, duplicates merged.

    Args:
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(self, merge_iou: float = 0.15, late: str = "as_current", align: bool = False) -> None:
        require_threshold(merge_iou=merge_iou)
        self._merge_iou = merge_iou
        super().__init__(late, align)

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return [merge_duplicates(pool(groups), iou_threshold=self._merge_iou)]


@POLICIES.register("late_fusion")
class LateFusion(PooledBoxes):
    """AB3DMOT on all agents' boxes, duplicates merged.

    Args:
        merge_iou: BEV IoU from which two agents' boxes of a class are the same object, in (0, 1].
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(
        self,
        merge_iou: float = 0.15,
        gate: float = -0.2,
        hits: int = 3,
        age: int = 2,
        late: str = "as_current",
        align: bool = False,
    ) -> None:
        self._settings = (gate, hits, age)
        super().__init__(merge_iou, late, align)

    def make_tracker(self) -> Tracker:
        return ab3dmot(*self._settings)
