"""Graph Lap-CoMOT (Damanaki, Piperigkos, Gkillas and Lalos, 2025): boxes of all agents refined on one graph.

All boxes of a frame are the vertices of a graph, and each is anchored at the other agents' boxes of the same object;
the extended Laplacian's least squares (eq. 8-10) moves them, and AB3DMOT tracks them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coopsim.agents.ab3dmot_policy import AB3DMOTBased
from coopsim.catalog import POLICIES
from coopsim.fusion.laplacian import anchors_aos, anchors_tsa, group, nearest_graph, refine, refine_sparse
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count, require_flag, require_threshold
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.affinity.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage, missed, nobody
from coopsim.tracking.tracker import Tracker, Turn, sane
from coopsim.types import Detections, Ints


class GraphLap(AB3DMOTBased):
    """What both variants share.

    Args:
        match_iou: 3D IoU from which boxes of two agents are one object, in (0, 1].
        neighbours: 0 for the fully connected graph of the paper, on which a box hardly moves towards its own anchor
            (1/N^2); else each box is connected to this many nearest ones.
        one_per_object: of the boxes of one object only the first agent's is tracked. The paper tracks them all.
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(
        self,
        match_iou: float = 0.1,
        neighbours: int = 0,
        one_per_object: bool = False,
        gate: float = -0.2,
        hits: int = 3,
        age: int = 2,
        late: str = "as_current",
        align: bool = False,
    ) -> None:
        require_threshold(match_iou=match_iou)
        require_count(0, neighbours=neighbours)
        require_flag(one_per_object=one_per_object)
        self._match_iou, self._neighbours, self._one_per_object = match_iou, neighbours, one_per_object
        super().__init__(gate, hits, age, late, align)

    def _pool(self, groups: Sequence[Detections]) -> tuple[Detections, Ints, Ints]:
        """All boxes, the number of each one's agent, and that of its object."""
        whole = [sane(each) for each in groups]
        pooled, agent = Detections.concatenate(whole), np.repeat(np.arange(len(whole)), [len(each) for each in whole])
        return pooled, agent, group(pooled.boxes.array, agent, self._match_iou, label=pooled.label)

    def _refined(self, pooled: Detections, anchor: Floats, same: Ints) -> Detections:
        """The boxes with their centres refined."""
        center = pooled.boxes.center
        if self._neighbours:
            center = refine_sparse(center, anchor, nearest_graph(center, self._neighbours))
        else:
            center = refine(center, anchor)
        moved = replace(pooled, boxes=Boxes3D(center, pooled.boxes.size, pooled.boxes.yaw))
        return moved[np.unique(same, return_index=True)[1]] if self._one_per_object else moved


@POLICIES.register("graph_lap_aos")
class GraphLapAOS(GraphLap):
    """All in one stage: a box is anchored at the mean of its partners (eq. 11). Parameters as in `GraphLap`."""

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        pooled, _, same = self._pool(groups)
        return [self._refined(pooled, anchors_aos(pooled.boxes.center, same), same)]


@POLICIES.register("graph_lap_tsa")
class GraphLapTSA(GraphLap):
    """One stage per agent, anchored at that agent's boxes (eq. 12-13): the others' first, then the own.

    Later stages only extend tracks that the stages before missed (algorithm 1, lines 18-20). In the paper they begin
    tracks, too (line 21); not here, because every box stands in every stage, so each would begin another track of an
    object that the stage before has just updated. Parameters as in `GraphLap`.
    """

    def make_tracker(self) -> Tracker:
        extend = Cascade([Stage(giou_3d, hungarian, gate=self._settings[0], tracks=missed)])
        return ab3dmot(*self._settings, later=Turn(extend, born=nobody))

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        pooled, agent, same = self._pool(groups)
        stages = [*range(1, len(groups)), 0]
        anchors = (anchors_tsa(pooled.boxes.center, same, agent, stage) for stage in stages)
        return [self._refined(pooled, anchor, same) for anchor in anchors]
