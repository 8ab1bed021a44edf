"""The network of instance queries: what each agent does alone, and how agents cooperate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.geometry.nms import nms_bev
from coopsim.nn.detector.decode import DUPLICATE_IOU, GROUP_OF_LABEL, GROUPS
from coopsim.nn.queries.attention import InstanceHistory, mlp
from coopsim.nn.queries.cooptrack_fusion import BLOCK, ComparedInstances, CoopTrackFusion, ReceivedInstances
from coopsim.nn.queries.decoder import InstanceDecoder, InstanceHeads, MotionFeatures, QueryStart
from coopsim.nn.queries.instances import LONGEST_S, Instances, met
from coopsim.nn.queries.univ2x_fusion import UniV2XFusion
from coopsim.support.checks import require_choice, require_count
from coopsim.types import BevGrid
from coopsim.types.valid_detections import FARTHEST_M

FUSIONS = ("none", "cooptrack", "univ2x")
_MOST, _LEAST_M = 1024, 0.05


@dataclass(frozen=True, slots=True)
class QueryConfig:
    """Sizes of the network.

    Attributes:
        fusion: name in `FUSIONS`; "none" for the network of one agent.
        features: channels of the encoder's maps.
        width: D, channels of an instance; 16 divides it.
        places: most instances that an agent keeps.
        layers: number of layers of the decoder, and of the attention to the past.
        heads: number of heads of all attention; divides `width`.
        history: frames of the past; 0: none.
        motion: features of motion in the fusion "cooptrack"; False, here and in the next two, for ablations.
        alignment: latent alignment of features.
        graph: learned association; without it, instances are paired by distance.

    Raises:
        InvalidValueError: a size is not accepted.
    """

    fusion: str = "none"
    features: int = 64
    width: int = 64
    places: int = 64
    layers: int = 2
    heads: int = 4
    history: int = 4
    motion: bool = True
    alignment: bool = True
    graph: bool = True

    def __post_init__(self) -> None:
        require_choice("fusion", self.fusion, FUSIONS)
        require_count(
            1, _MOST, features=self.features, width=self.width, places=self.places, layers=self.layers, heads=self.heads
        )
        require_count(0, 32, history=self.history)
        if self.fusion != "cooptrack" and not (self.motion and self.alignment and self.graph):
            raise InvalidValueError(
                f"motion, alignment and graph are parts of the fusion 'cooptrack', not of {self.fusion!r}"
            )
        if self.width % BLOCK or self.width % self.heads:
            raise InvalidValueError(f"width must be divisible by {BLOCK} and by {self.heads} heads, got {self.width}")


@dataclass(frozen=True, slots=True, eq=False)
class SeenMap:
    """Map (C, h, w) of one agent's encoder in a frame, and the peaks `found` by its head, as instances without
    features.
    """

    features: Tensor
    grid: BevGrid
    found: Instances


@dataclass(frozen=True, slots=True, eq=False)
class QueryStep:
    """Result of a frame.

    Attributes:
        instances: K refined instances, duplicates among them; they remember this frame.
        logits: (K, 9) of their classes.
        compared: associations, by sender.
    """

    instances: Instances
    logits: Tensor
    compared: list[ComparedInstances]


class AgentQueryNet(nn.Module):
    """The network of one agent: from peaks and what was carried over to decoded instances."""

    def __init__(self, config: QueryConfig) -> None:
        super().__init__()
        width, sizes = config.width, (config.layers, config.heads)
        self.start = QueryStart(config.features, width)
        self.decoder = InstanceDecoder(config.features, width, *sizes)
        self.semantic, self.motion = mlp(width, width, width), MotionFeatures(width)
        self.semantic_history = InstanceHistory(width, *sizes)
        self.motion_history = InstanceHistory(width, *sizes)
        self.heads = InstanceHeads(width)

    def queries(self, known: Instances, seen: SeenMap) -> Instances:
        """Return instances with queries as their semantics."""
        return replace(known, semantic=self.start(known, seen.features, seen.grid))

    def decode(self, asked: Instances, seen: SeenMap) -> Instances:
        """Return decoded instances, with features of semantics and motion that know the past (MDFE)."""
        place_m = asked.box[:, :2]
        query = self.decoder(asked.semantic, asked, seen.features, seen.grid)
        semantic, motion = self.semantic(query), self.motion(asked.box, asked.velocity)
        if asked.past_age_s.shape[1]:
            semantic = self.semantic_history(semantic, asked.past_semantic, asked.past_age_s, place_m)
            motion = self.motion_history(motion, asked.past_motion, asked.past_age_s, place_m)
        return replace(asked, semantic=semantic, motion=motion)

    def refine(self, decoded: Instances) -> tuple[Instances, Tensor]:
        """Return refined instances, which remember this frame, and the logits of their classes (K, 9)."""
        logits = self.heads.logits(decoded, decoded.semantic)
        box, velocity = self.heads.boxes(decoded, decoded.semantic, decoded.motion)
        score, label = logits.sigmoid().max(1) if len(decoded) else (decoded.score, decoded.label)
        refined = replace(decoded, box=box, velocity=velocity, score=score, label=label)
        return refined.remembered(), logits


class QueryNet(nn.Module):
    """The network of an agent that receives the instances of others."""

    def __init__(self, config: QueryConfig) -> None:
        super().__init__()
        self.config = config
        self.agent = AgentQueryNet(config)
        self.fusion = _make_fusion(config)

    def nothing(self) -> Instances:
        """Return no instances: what an agent knows before its first frame."""
        return Instances.none(self.config.width, self.config.history, next(self.parameters()).device)

    def seen(self, box: Tensor, score: Tensor, label: Tensor) -> Instances:
        """Return what is seen for the first time, as instances: boxes (K, 7), scores and labels (K,)."""
        return Instances.seen(box, score, label, self.config.width, self.config.history)

    def forward(
        self,
        before: Instances,
        dt_s: float,
        seen: SeenMap,
        received: Sequence[ReceivedInstances] = (),
        *,
        least_affinity: float = 0.5,
        by_rule: bool = False,
    ) -> QueryStep:
        """Return the instances of a frame.

        Args:
            before: instances of the frame before, in the agent's compass frame now, where they were then.
            dt_s: time since then.
            seen: the agent's own map now.
            received: senders in the order in which they are fused.
            least_affinity: smallest affinity of a pair, in [0, 1]; above 1 no pair is made.
            by_rule: pair instances by distance, see `CoopTrackFusion`.
        """
        most = self.config.places
        prior = before.advanced(dt_s) if dt_s <= LONGEST_S else self.nothing()
        known = self.agent.queries(met(prior, seen.found, dt_s).surest(most), seen)
        fuse = self.fusion if received else None
        compared: list[ComparedInstances] = []
        if fuse is not None and fuse.before_decoding:
            known, compared = fuse(known, received, least_affinity, most, by_rule=by_rule)
        known = self.agent.decode(known, seen)
        if fuse is not None and not fuse.before_decoding:
            known, compared = fuse(known, received, least_affinity, most, by_rule=by_rule)
        refined, logits = self.agent.refine(known)
        return QueryStep(refined, logits, compared)

    def shown(self, received: ReceivedInstances) -> tuple[Instances, Tensor]:
        """Return the refined instances that a message alone shows, one for each in it, and their logits (K, 9).

        The receiver knows nothing and has an empty map.
        """
        assert self.fusion is not None
        own = received.instances[torch.arange(0)]
        known, _ = self.fusion(own, [received], 0.0, len(received.instances))
        if self.fusion.before_decoding:
            empty = own.box.new_zeros(self.config.features, 1, 1)
            known = self.agent.decode(known, SeenMap(empty, BevGrid((-1, 1), (-1, 1), 2.0), own))
        return self.agent.refine(known)


LEAST_SCORE = 0.1
"""Peaks and instances with smaller scores are forgotten."""


def kept_instances(found: Instances) -> Instances:
    """Return the instances that are carried over: finite, of some size, believed in, and no duplicates."""
    numbers = torch.cat([found.box, found.velocity, found.semantic, found.motion], dim=1)
    sized = (found.box[:, 3:6] > _LEAST_M).all(1) & (found.box[:, :3].abs() < FARTHEST_M).all(1)
    return without_duplicates(found[torch.isfinite(numbers).all(1) & sized & (found.score >= LEAST_SCORE)])


def without_duplicates(found: Instances) -> Instances:
    """Return the instances less those that overlap a surer one of a group of classes, as the detector does it."""
    box, score = found.box.double().cpu().numpy(), found.score.double().cpu().numpy()
    group = GROUP_OF_LABEL[found.label.cpu().numpy()]
    kept = [np.zeros(0, np.int64)]
    for each in range(len(GROUPS)):
        rows = np.flatnonzero(group == each)
        kept.append(rows[nms_bev(box[rows], score[rows], DUPLICATE_IOU)])
    return found[torch.from_numpy(np.sort(np.concatenate(kept))).to(found.box.device)]


def _make_fusion(config: QueryConfig) -> CoopTrackFusion | UniV2XFusion | None:
    if config.fusion == "none":
        return None
    if config.fusion == "univ2x":
        return UniV2XFusion(config.width)
    return CoopTrackFusion(config.width, motion=config.motion, alignment=config.alignment, graph=config.graph)
