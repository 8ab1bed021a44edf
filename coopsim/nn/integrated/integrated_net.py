"""The network of integrated detection and tracking (Hu, Wang and Wang, "Integrated Detection and Tracking Framework for
3D Multi-Object Tracking in Vehicle-Infrastructure Cooperation", eq. 12-18), on the maps of a cooperative network.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig, CooperativeNet
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.integrated.encoder import DeformableAttention, EncodedMap, IntegratedEncoder, PriorMap
from coopsim.nn.queries.attention import AmongInstances
from coopsim.nn.queries.decoder import BoxEmbedding, InstanceHeads
from coopsim.nn.queries.instances import LONGEST_S, Instances
from coopsim.support.checks import require_count
from coopsim.types import BevGrid
from coopsim.types.taxonomy import CLASS_NAMES

_MOST, _LEAST_M = 1024, 0.05


@dataclass(frozen=True, slots=True)
class IntegratedConfig:
    """Sizes of the network.

    Attributes:
        cooperative: the network that makes fused maps, a part of this one.
        width: D, channels of a query; 4 and `heads` divide it.
        places: most objects that a branch looks for.
        encoder_layers: number of layers of the deformable encoder.
        decoder_layers: number of layers of each branch's decoder.
        heads: number of heads of all attention but that to the map before, which has one.
        points: places of the map that each head reads.

    Raises:
        InvalidValueError: a size is not accepted.
    """

    cooperative: CooperativeConfig = field(default_factory=CooperativeConfig)
    width: int = 64
    places: int = 96
    encoder_layers: int = 1
    decoder_layers: int = 2
    heads: int = 4
    points: int = 4

    def __post_init__(self) -> None:
        require_count(
            1, _MOST, width=self.width, places=self.places, encoder_layers=self.encoder_layers,
            decoder_layers=self.decoder_layers, heads=self.heads, points=self.points,
        )  # fmt: skip
        if self.width % 4 or self.width % self.heads:
            raise InvalidValueError(f"width must be divisible by 4 and by {self.heads} heads, got {self.width}")


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedStep:
    """Result of a frame.

    Attributes:
        detected: objects that the detection branch finds, with s_d as scores; duplicates among them.
        detected_logits: (K, 9) of their classes.
        detected_turn: (K,) logits of facing the other way than the peak.
        predicted: the objects of the frame before, where the prediction branch finds them now, with s_t as scores.
        predicted_logits: (N, 9) of their classes.
        predicted_turn: (N,) logits of facing the other way than in the frame before.
        prior: downsampled map for the next frame.
    """

    detected: Instances
    detected_logits: Tensor
    detected_turn: Tensor
    predicted: Instances
    predicted_logits: Tensor
    predicted_turn: Tensor
    prior: PriorMap


class IntegratedNet(nn.Module):
    """Detect objects in a fused map, and find those of the frame before in it.

    The queries of the detection branch are learned, one for each class; they are put at the peaks of the cooperative
    network's head. Those of the prediction branch are the features of the frame before, at boxes moved on.
    """

    def __init__(self, config: IntegratedConfig) -> None:
        super().__init__()
        self.config = config
        sizes = (config.width, config.decoder_layers, config.heads, config.points)
        self.cooperative = CooperativeNet.from_config(config.cooperative)
        self.encoder = IntegratedEncoder(
            config.cooperative.features, config.width, config.encoder_layers, config.heads, config.points
        )
        self.learned = nn.Embedding(len(CLASS_NAMES), config.width)
        self.detection, self.prediction = Branch(*sizes), Branch(*sizes)
        self.elapsed = nn.Linear(1, config.width, bias=False)

    def nothing(self) -> Instances:
        """Return no objects: what is known before a first frame."""
        return Instances.none(self.config.width, 0, next(self.parameters()).device)

    def seen(self, box: Tensor, score: Tensor, label: Tensor) -> Instances:
        """Return what is seen for the first time: boxes (K, 7), scores and labels (K,)."""
        return Instances.seen(box, score, label, self.config.width, 0)

    def forward(
        self, fused: Tensor, grid: BevGrid, peaks: Instances, tracks: Instances, before: PriorMap | None, dt_s: float
    ) -> IntegratedStep:
        """Return the objects of a frame.

        Args:
            fused: (features, H, W) of the cooperative network; rows and columns even.
            grid: its cells, in the agent's compass frame.
            peaks: instances at the peaks of the cooperative network's head.
            tracks: objects of the frame before, in the agent's compass frame now, where they were then; dropped if that
                is too long ago.
            before: the map of the frame before, in that frame, too; None: there is none.
            dt_s: time since the frame before.
        """
        if dt_s > LONGEST_S:
            tracks, before = self.nothing(), None
        encoded = self.encoder(fused, grid, before, 0.0 if before is None else dt_s)
        asked = replace(peaks, semantic=self.learned(peaks.label))
        detected, detected_logits, detected_turn = self.detection(asked, encoded)
        score, label = detected_logits.sigmoid().max(1) if len(peaks) else (peaks.score, peaks.label)
        asked = tracks.advanced(dt_s)
        asked = replace(asked, semantic=asked.semantic + self.elapsed(fused.new_tensor([dt_s])))
        predicted, predicted_logits, predicted_turn = self.prediction(asked, encoded)
        believed = predicted_logits.sigmoid().amax(1) if len(tracks) else tracks.score
        return IntegratedStep(
            replace(detected, score=score, label=label), detected_logits, detected_turn,
            replace(_sound(predicted, asked), score=believed), predicted_logits, predicted_turn, encoded.prior,
        )  # fmt: skip


def _sound(predicted: Instances, asked: Instances) -> Instances:
    """Return the predicted objects, those whose numbers are none where they were asked for, and none without size."""
    numbers = torch.cat([predicted.box, predicted.velocity, predicted.semantic], dim=1)
    sound = torch.isfinite(numbers).all(1, keepdim=True)
    box = torch.where(sound, predicted.box, asked.box)
    return replace(
        predicted,
        box=torch.cat([box[:, :3], box[:, 3:6].clamp_min(_LEAST_M), box[:, 6:]], dim=1),
        velocity=torch.where(sound, predicted.velocity, asked.velocity),
        semantic=torch.where(sound, predicted.semantic, asked.semantic),
    )


_SELDOM = -3.0
"""Logit of a fresh branch that a box faces the other way."""

_LEAST_HALF_M = 0.6
"""Of small objects, places are sought within this along and across."""


class BranchDecoder(nn.Module):
    """Let queries attend to the map in and around their boxes, and to each other, layer by layer."""

    def __init__(self, width: int, layers: int, heads: int, points: int) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers))
        self.across = nn.ModuleList(DeformableAttention(width, heads, points) for _ in range(layers))
        self.among = nn.ModuleList(AmongInstances(width, heads) for _ in range(layers))

    def forward(self, query: Tensor, box: Tensor, encoded: EncodedMap) -> Tensor:
        """Return the features (K, D) of queries (K, D) at boxes (K, 7)."""
        place_m, axes_m = box[:, :2], box_axes(box)
        for norm, across, among in zip(self.norms, self.across, self.among, strict=True):
            query = query + across(norm(query), place_m, axes_m, encoded.features, encoded.grid)
            query = among(query, place_m)
        return query


class Branch(nn.Module):
    """Decode queries to features, class scores, boxes and velocities, which start as the given ones (eq. 15-18).

    Where a heading is half a turn off, XIOU is 0 and has no gradient: so turning a box around is a logit of its own.
    """

    def __init__(self, width: int, layers: int, heads: int, points: int) -> None:
        super().__init__()
        self.embed, self.norm = BoxEmbedding(width), nn.LayerNorm(width)
        self.decoder = BranchDecoder(width, layers, heads, points)
        self.heads, self.turn = InstanceHeads(width), start_as_zeros(nn.Linear(width, 1))
        nn.init.constant_(self.turn.bias, _SELDOM)

    def forward(self, asked: Instances, encoded: EncodedMap) -> tuple[Instances, Tensor, Tensor]:
        """Return objects with features, boxes and velocities, their class logits (K, 9), and logits (K,) of facing the
        other way.

        Boxes with a logit above 0 are turned around. `asked` are objects at their reference boxes, with queries as
        semantics.
        """
        known = self.embed(asked)
        feature = self.decoder(self.norm(asked.semantic + known), asked.box, encoded)
        logits = self.heads.logits(asked, feature)
        box, velocity = self.heads.boxes(asked, feature, known)
        turn = self.turn(feature).squeeze(1)
        return replace(asked, semantic=feature, box=turned_around(box, turn > 0), velocity=velocity), logits, turn


def turned_around(box: Tensor, which: Tensor) -> Tensor:
    """Return boxes (K, 7), those of `which` (K,) turned by half a turn."""
    return torch.cat([box[:, :6], box[:, 6:] + torch.pi * which[:, None]], dim=1)


def box_axes(box: Tensor) -> Tensor:
    """Return half the length and half the width of boxes (K, 7) as vectors, the columns of (K, 2, 2)."""
    half = (box[:, 3:5] / 2).clamp_min(_LEAST_HALF_M)
    cos, sin = box[:, 6].cos(), box[:, 6].sin()
    turn = torch.stack([torch.stack([cos, -sin], dim=1), torch.stack([sin, cos], dim=1)], dim=1)
    return turn * half[:, None]
