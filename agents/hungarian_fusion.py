"""Boxes of all agents, matched by the Hungarian algorithm and fused: the row "Hungarian" of Hu, Wang and Wang,
"Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure Cooperation",
Table I.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from coopsim.agents.ab3dmot_policy import AB3DMOTTracking
from coopsim.catalog import POLICIES
from coopsim.fusion.pooling import merge_matched
from coopsim.support.checks import require_threshold
from coopsim.types import Detections


@POLICIES.register("hungarian")
@dataclass(kw_only=True, eq=False)
class HungarianFusion(AB3DMOTTracking):
    """AB3DMOT on the boxes of all agents, matched pair by pair of agents and merged. Parameters: `AB3DMOTTracking`.

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
