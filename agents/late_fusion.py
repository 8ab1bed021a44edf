"""Late fusion: agents share boxes; each receiver pools them, merges duplicates, and tracks the rest.

The baseline of that name in the tables of cooperative perception (V2V4Real, Xu et al., CVPR 2023; DINO-CoDT, He et al.,
Table II). With `late="as_current"` a box is taken as if it were measured now: pose noise and latency show in full.
"""

from __future__ import annotations

from collections.abc import Sequence

from coopsim.agents.ab3dmot import AB3DMOTBased
from coopsim.catalog import POLICIES
from coopsim.checks import require_threshold
from coopsim.fusion.late import merge_duplicates
from coopsim.types import Detections


@POLICIES.register("late_fusion")
class LateFusion(AB3DMOTBased):
    """AB3DMOT on all agents' boxes, duplicates merged.

    Args:
        merge_iou: BEV IoU from which two boxes of a class are the same object, in (0, 1].
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
    """

    uplink = "detections"

    def __init__(
        self, merge_iou: float = 0.15, gate: float = -0.2, hits: int = 3, age: int = 2, late: str = "as_current"
    ) -> None:
        require_threshold(merge_iou=merge_iou)
        self._merge_iou = merge_iou
        super().__init__(gate, hits, age, late)

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return [merge_duplicates(Detections.concatenate(groups), iou_threshold=self._merge_iou)]
