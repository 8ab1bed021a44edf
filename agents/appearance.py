"""Policies that recognise objects by appearance: YOLOO and the tracking of DINO-CoDT."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from coopsim.agents.boxes import PooledBoxes
from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import policy_row
from coopsim.comms.uplinks.share_detections import EmbedOnce, ShareEmbedded
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.geometry.assignment import Assigner, greedy, hungarian
from coopsim.support.checks import require_choice, require_flag, require_number
from coopsim.tracking.affinity import fgam, giou_3d, iou_3d
from coopsim.tracking.appearance import Appearance, LastEmbedding, YolooAffinity
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge, Remembered, VelocityAdaptiveAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity, Motion
from coopsim.tracking.motion.turning import ConstantTurnRateAcceleration
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections, Observation
from coopsim.types.taxonomy import SUPERCLASS_NUMBERS, Superclass
from coopsim.types.valid_detections import normalize_embeddings

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder


@dataclass(kw_only=True, eq=False)
class DescribedBoxes(PooledBoxes):
    """Base of policies that embed each agent's own detections and send the vectors along. Parameters: `PooledBoxes`."""

    def __post_init__(self) -> None:
        embedder = self.make_embedder()
        self._embed = None if embedder is None else EmbedOnce(embedder)
        super().__post_init__()

    def make_embedder(self) -> Embedder | None:
        """Make the embedder of detections; None: they stay as the environment has them."""
        return None

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if self._embed is None:
            return super().make_uplink(spec, rng)
        return ShareEmbedded(self._embed, spec, spec.codec or "detections", self.velocities)

    def perceive(self, agent: str, observation: Observation) -> Detections:
        return observation.detections if self._embed is None else self._embed(observation, self.specs[agent])


@policy_row("yoloo_geometry")
class YolooGeometry(PooledBoxes):
    """Greedy matching by YOLOO's flexible geometric constraint (Gu et al., "YOLOO: You Only Learn from Others Once",
    eq. 8-9): no pair farther apart than the smaller box's diagonal, and no gate to tune.

    Further parameters: `PooledBoxes`.

    Attributes:
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    method = "YOLOO (Gu et al.), its geometric constraint alone"

    hits: int = 3
    age: int = 2

    def make_tracker(self) -> Tracker:
        return Tracker(ConstantVelocity(), Cascade([Stage(fgam, greedy, gate=0.0)]), HitsAndAge(self.hits, self.age))


_WITH_EMBEDDINGS, _WITHOUT = "pairs compared by looks and geometry", "pairs compared by geometry alone"
"""Names of what is counted."""


@policy_row("yoloo")
class Yoloo(DescribedBoxes, YolooGeometry):
    """Greedy matching by the sum of two costs, of appearance and distance (eq. 9). The paper tracks for one agent; here
    all agents' boxes are pooled.

    Each agent embeds its own detections by the points in them, unless the environment's detector or embedder does, and
    sends the vectors along. A pair without them (few points, no LiDAR, or vectors of another length) is compared by
    geometry alone; `counts` has the number. Further parameters: `YolooGeometry`.

    Attributes:
        appearance: use embeddings; without, this is `yoloo_geometry`.
        weights: name or path of the point encoder's weights.
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
        from coopsim.detection.identity_embedders import PointIdentity

        return PointIdentity(self.weights)

    def make_tracker(self) -> Tracker:
        if self._embed is None:
            return super().make_tracker()
        cost = Stage(YolooAffinity(self._count), greedy, gate=0.0)
        return Tracker(ConstantVelocity(), Cascade([cost]), HitsAndAge(self.hits, self.age), appearance=LastEmbedding())

    def _count(self, with_looks: int, without: int) -> None:
        self.counts[_WITH_EMBEDDINGS] += with_looks
        self.counts[_WITHOUT] += without


NIMBLE = Superclass.PEDESTRIAN.classes
"""Classes that turn at will: people, on foot or on two wheels."""

_EMBEDDED, _NOT_EMBEDDED = "boxes tracked with an embedding", "boxes tracked by geometry alone"
"""Names of what is counted."""

_GATES = {"iou_3d": ("in (0, 1]", lambda gate: 0 < gate <= 1), "giou_3d": ("in [-1, 1]", lambda gate: -1 <= gate <= 1)}
_AFFINITIES = {"iou_3d": iou_3d, "giou_3d": giou_3d}


def reid_in_words(embedder: str | None) -> str:
    """Return a policy's re-identification in words, for its `method`."""
    return "without Re-ID" if embedder is None else f"Re-ID by {embedder}"


@policy_row("dino_codt_tracking")
class DinoCoDTTracking(DescribedBoxes):
    """Tracking of DINO-CoDT (He et al., 2025, sec. III-F to III-H): rules by class, re-identification, age by speed.

    Each class has its motion model and assignment; embeddings match the boxes that are left over. They come from
    `embedder`, the environment or the detector; the paper's are DINOv2's. `counts` has the numbers of boxes tracked
    with an embedding and without: without the sensors that the embedder needs, out of their view, or with another
    length than the receiver's own.

    Further parameters: `PooledBoxes`.

    Attributes:
        gate: smallest affinity of a match: in (0, 1] with "iou_3d", in [-1, 1] with "giou_3d". The paper finds -0.5 to
            -0.2 best (sec. IV-E-2), which only GIoU reaches.
        affinity: similarity of boxes, "iou_3d" (sec. III-G) or "giou_3d".
        motion: the paper's assignment of motion models to classes. "section_3f": vehicles and trucks by
            constant velocity, people and two-wheelers by constant turn rate and acceleration (CTRA). "section_4b", with
            which its results were made: cars, people and two-wheelers by CTRA, vans, trucks and buses by constant
            velocity.
        by_superclass: match boxes within a superclass of the paper's Table I, not only within a class; a track keeps
            the class that it began with.
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until the track of a standing object is dropped (A_c; one for all classes).
        age_per_m_s: frames more per m/s (alpha). The paper finds 1.0 to 1.2 best (sec. IV-E-2).
        coast: frames without a detection for which a track is still reported; None: while it is kept, as AB3DMOT does.
        window_s: age, see `Appearance` for this and the next four, from which an embedding is forgotten.
        similarity: smallest cosine similarity of a track and a detection (beta).
        reach_m: largest distance of an object from its predicted place, for each frame without a detection.
        cross_similarity: smallest cosine similarity of two agents' detections of one object.
        cross_reach_m: largest distance between two agents' boxes of one object.
        embedder: name or spec of an embedder, such as "picture_identity", of each agent's own detections; None: only
            the vectors of detector and environment.
    """

    gate: float = 0.01
    affinity: str = "iou_3d"
    motion: str = "section_3f"
    by_superclass: bool = False
    hits: int = 3
    age: int = 2
    age_per_m_s: float = 0.2
    coast: int | None = 1
    window_s: float = Appearance().window_s
    similarity: float = Appearance().similarity
    reach_m: float = Appearance().reach_m
    cross_similarity: float = Appearance().cross_similarity
    cross_reach_m: float = Appearance().cross_reach_m
    embedder: str | None = None

    def __post_init__(self) -> None:
        require_choice("affinity", self.affinity, _AFFINITIES)
        require_choice("motion", self.motion, ("section_3f", "section_4b"))
        accepted, accepts = _GATES[self.affinity]
        require_number(f"{accepted} with affinity {self.affinity!r}", accepts, gate=self.gate)
        require_flag(by_superclass=self.by_superclass)
        self.counts = Counter()  # for who fuses without an episode
        self.method = f"DINO-CoDT (He et al., 2025), its tracking alone, {reid_in_words(self.embedder)}"
        super().__post_init__()

    def make_embedder(self) -> Embedder | None:
        if self.embedder is None:
            return None
        from coopsim.detection.embedder import make_embedder

        made = make_embedder(self.embedder)
        cameras = "surround" if made.needs.cameras else False
        self.needs = Needs(lidar=made.needs.lidar, cameras=cameras, any_rig=True, all_agents=False)
        return made

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        fused = super().fuse(groups)
        for each in fused:
            known = 0 if each.embedding is None else int(normalize_embeddings(each.embedding)[1].sum())
            self.counts[_EMBEDDED] += known
            self.counts[_NOT_EMBEDDED] += len(each) - known
        return fused

    def make_tracker(self) -> TrackersByClass:
        turning = ConstantTurnRateAcceleration(reverse_speed_mps=0.2)  # people hardly walk backwards
        by_class: dict[tuple[int, ...], Tracker] = {NIMBLE: self._tracker(turning, greedy)}
        if self.motion == "section_4b":
            by_class[Superclass.VEHICLE.classes] = self._tracker(ConstantTurnRateAcceleration(), hungarian)
        return TrackersByClass(self._tracker(ConstantVelocity(), hungarian), by_class)

    def _tracker(self, motion: Motion, assigner: Assigner) -> Tracker:
        appearance = Appearance(
            self.window_s,
            similarity=self.similarity,
            reach_m=self.reach_m,
            cross_similarity=self.cross_similarity,
            cross_reach_m=self.cross_reach_m,
        )
        rule = VelocityAdaptiveAge(self.hits, self.age, self.age_per_m_s, self.coast)
        lifecycle = Remembered(rule, self.hits)
        by_boxes = Stage(_AFFINITIES[self.affinity], assigner, self.gate, tracks=lifecycle.in_view)
        stages = Cascade([by_boxes, appearance.stage()], SUPERCLASS_NUMBERS if self.by_superclass else None)
        return Tracker(motion, stages, lifecycle, appearance=appearance)
