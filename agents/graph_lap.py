"""Graph Lap-CoMOT (Damanaki, Piperigkos, Gkillas and Lalos, 2025): boxes of all agents refined on one graph.

All boxes of a frame are the vertices of a graph, and each is anchored at the other agents' boxes of the same object;
the extended Laplacian's least squares (eq. 8-10) moves them, and AB3DMOT tracks them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.agents.boxes import AB3DMOTTracking
from coopsim.agents.tracking_policy import policy_row
from coopsim.fusion.laplacian import anchors_aos, anchors_tsa, group, nearest_graph, refine, refine_sparse
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count, require_flag, require_threshold
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage, missed, nothing
from coopsim.tracking.tracker import AssociationRound, Tracker
from coopsim.types import AgentSpec, Detections, Ints

_OVERLAPPING = 0.3
"""3D GIoU of boxes that surely overlap."""


@dataclass(kw_only=True, eq=False)
class GraphLap(AB3DMOTTracking):
    """A policy that refines the pooled boxes on one graph and tracks them. Further parameters: `AB3DMOTTracking`.

    Attributes:
        match_iou: 3D IoU from which boxes of two agents are one object, in (0, 1].
        neighbours: 0 for the fully connected graph of the paper, on which a box hardly moves towards its own anchor
            (1/N^2); else each box is connected to this many nearest ones.
        one_per_object: track only the first agent's box of each object. The paper, with two agents, tracks all boxes;
            None: so does this, but with more agents, each of which would add a track, one of each object.
        matched_only: move only the boxes of objects that several agents see. In the paper, and as the equations read,
            the others move with them.
    """

    match_iou: float = 0.1
    neighbours: int = 0
    one_per_object: bool | None = None
    matched_only: bool = False

    def __post_init__(self) -> None:
        require_threshold(match_iou=self.match_iou)
        require_count(0, neighbours=self.neighbours)
        require_flag(matched_only=self.matched_only)
        if self.one_per_object is not None:
            require_flag(one_per_object=self.one_per_object)
        self._one = bool(self.one_per_object)
        super().__post_init__()

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        if self.one_per_object is None:
            self._one = len(self.specs) > 2
        super().begin(spec, rng)

    def _pool(self, groups: Sequence[Detections]) -> tuple[Detections, Ints, Ints]:
        """Return all boxes, the number (N,) of each one's agent, and that of its object."""
        pooled = Detections.concatenate(groups)
        agent = np.repeat(np.arange(len(groups)), [len(each) for each in groups])
        return pooled, agent, group(pooled.boxes.array, agent, self.match_iou, label=pooled.label)

    def _refined(self, pooled: Detections, anchor: Floats, object_of: Ints) -> Detections:
        """Return the boxes with their centres refined, or one box per object."""
        center = pooled.boxes.center
        if self.neighbours:
            refined = refine_sparse(center, anchor, nearest_graph(center, self.neighbours))
        else:
            refined = refine(center, anchor)
        if self.matched_only:
            shared = np.bincount(object_of)[object_of] > 1
            refined = np.where(shared[:, None], refined, center)
        moved = replace(pooled, boxes=Boxes3D(refined, pooled.boxes.size, pooled.boxes.yaw))
        return moved[np.unique(object_of, return_index=True)[1]] if self._one else moved


@policy_row("graph_lap_aos")
class GraphLapAOS(GraphLap):
    """All in one stage: a box is anchored at the mean of its partners (eq. 11). Parameters: `GraphLap`."""

    method = "Graph Lap-CoMOT (Damanaki et al., 2025), all in one stage"

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        pooled, _, object_of = self._pool(groups)
        return [self._refined(pooled, anchors_aos(pooled.boxes.center, object_of), object_of)]


@policy_row("graph_lap_tsa")
class GraphLapTSA(GraphLap):
    """A stage per agent, anchored at that agent's boxes (eq. 12-13): the senders' first, then the receiver's.

    Later stages only extend tracks that the stages before missed (algorithm 1, lines 18-20). In the paper they begin
    tracks, too (line 21); not here, because every box stands in every stage, so each would begin another track of an
    object that the stage before has just updated. Where one box of each object is tracked, later stages only take what
    overlaps a missed track: all boxes stand there, and a neighbour's would be near enough. Parameters: `GraphLap`.
    """

    method = "Graph Lap-CoMOT (Damanaki et al., 2025), a stage for each agent; later ones begin no tracks"

    def make_tracker(self) -> Tracker:
        gate = max(self.gate, _OVERLAPPING) if self._one else self.gate
        extend = Cascade([Stage(giou_3d, hungarian, gate=gate, tracks=missed)])
        return ab3dmot(self.gate, self.hits, self.age, later=AssociationRound(extend, initiator=nothing))

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        pooled, agent, object_of = self._pool(groups)
        stages = [*range(1, len(groups)), 0]
        anchors = (anchors_tsa(pooled.boxes.center, object_of, agent, stage) for stage in stages)
        return [self._refined(pooled, anchor, object_of) for anchor in anchors]
