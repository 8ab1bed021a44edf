"""One of the two branches: queries at boxes, a deformable decoder, and heads (Hu, Wang and Wang, eq. 15-18)."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.integrated.deformable_attention import DeformableAttention
from coopsim.nn.integrated.integrated_encoder import EncodedMap
from coopsim.nn.queries.instance_attention import AmongInstances
from coopsim.nn.queries.instance_decoder import BoxEmbedding, InstanceHeads
from coopsim.nn.queries.instances import Instances

_SELDOM = -3.0
"""Logit of a fresh branch that a box faces the other way."""

_LEAST_HALF_M = 0.6
"""Of small objects, places are sought within this along and across."""


class BranchDecoder(nn.Module):
    """Let queries look at the map in and around their boxes, and attend to each other, layer by layer.

    Args:
        width: channels of a query, and of the map.
        layers: number of layers.
        heads: of all attention.
        points: places of a head.
    """

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
    """From queries to objects: features, scores of classes, boxes and velocities. It starts with those it is given.

    Where a heading is half a turn off, XIOU is 0 and has no gradient: whether a box is to be turned around is a number
    of its own.

    Args:
        width: channels of a query.
        layers: of the decoder.
        heads: of all attention.
        points: places of a head.
    """

    def __init__(self, width: int, layers: int, heads: int, points: int) -> None:
        super().__init__()
        self.embed, self.norm = BoxEmbedding(width), nn.LayerNorm(width)
        self.decoder = BranchDecoder(width, layers, heads, points)
        self.heads, self.turn = InstanceHeads(width), start_as_zeros(nn.Linear(width, 1))
        nn.init.constant_(self.turn.bias, _SELDOM)

    def forward(self, asked: Instances, encoded: EncodedMap) -> tuple[Instances, Tensor, Tensor]:
        """Return objects with features, boxes and velocities, and two kinds of logits.

        These are of their classes (K, 9), and of facing the other way than they were asked for, (K,): those above 0 are
        turned around.

        Args:
            asked: objects at their reference boxes, with queries as their semantics.
            encoded: the map.
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
