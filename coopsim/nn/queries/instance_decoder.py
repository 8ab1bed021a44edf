"""The decoder of instance queries: what a map shows at an object, what is known of it, and who is near."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from coopsim.nn.covariance.box_patch import PLACES, box_patches
from coopsim.nn.detector.box_code import size_priors
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.instance_attention import AmongInstances, InstanceAttention, mlp
from coopsim.nn.queries.instances import Instances
from coopsim.types import BevGrid
from coopsim.types.taxonomy import CLASS_NAMES

_FAR_M, _HIGH_M, _FAST_M_S, _LOGIT, _FRAMES = 50.0, 2.0, 10.0, 4.0, 4.0
_NUMBERS = 12


class BoxEmbedding(nn.Module):
    """Make a vector of what is known of an object: size, heading, motion, height, range, score, class and how long.

    Where it is around the agent is not told, but for the range, so that every direction is alike.

    Args:
        width: length of the vector.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.net = mlp(_NUMBERS + len(CLASS_NAMES), width, width)

    def forward(self, known: Instances) -> Tensor:
        """Return (K, width)."""
        box = known.box
        size = torch.log(box[:, 3:6].clamp_min(1e-3) / size_priors(box.device)[known.label])
        numbers = torch.column_stack(
            [
                box[:, :2].norm(dim=1) / _FAR_M, box[:, 2] / _HIGH_M, size, box[:, 6].cos(), box[:, 6].sin(),
                known.velocity / _FAST_M_S, logit(known.score) / _LOGIT, known.hits.clamp(max=4) / _FRAMES,
                known.missed.clamp(max=4) / _FRAMES,
            ]
        )  # fmt: skip
        classes = nn.functional.one_hot(known.label, len(CLASS_NAMES)).to(numbers)
        embedded: Tensor = self.net(torch.cat([numbers, classes], dim=1))
        return embedded


class QueryStart(nn.Module):
    """Make queries of instances: from an agent's map at the object, its box, and what it was known as before.

    Args:
        features: channels of the map.
        width: channels of a query.
    """

    def __init__(self, features: int, width: int) -> None:
        super().__init__()
        self.look = nn.Linear(features * PLACES**2, width)
        self.embed = BoxEmbedding(width)
        self.carry = nn.Linear(width, width, bias=False)
        self.norm = nn.LayerNorm(width)

    def forward(self, known: Instances, features: Tensor, grid: BevGrid) -> Tensor:
        """Return queries (K, width).

        Args:
            known: at their reference points; their semantics are those of the frame before, zero for new ones.
            features: (C, h, w), of the agent's encoder.
            grid: the cells of the features.
        """
        seen = self.look(box_patches(features, known.box, grid))
        query: Tensor = self.norm(seen + self.embed(known) + self.carry(known.semantic))
        return query


class InstanceDecoder(nn.Module):
    """Let queries attend to each other and to the map around their reference points, layer by layer.

    Cross-attention reads the map at nine places in and around the box, as deformable attention reads it at a few (Zhu
    et al., "Deformable DETR", ICLR 2021, eq. 2), here at places that the box gives.

    Args:
        features: channels of the map.
        width: channels of a query.
        layers: number of layers.
        heads: number of heads.
    """

    def __init__(self, features: int, width: int, layers: int, heads: int) -> None:
        super().__init__()
        self.among = nn.ModuleList(AmongInstances(width, heads) for _ in range(layers))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers))
        self.across = nn.ModuleList(InstanceAttention(width, heads) for _ in range(layers))
        self.value = nn.Linear(features, width)
        self.place = nn.Parameter(torch.zeros(PLACES**2, width))
        nn.init.normal_(self.place, std=0.1)

    def forward(self, query: Tensor, known: Instances, features: Tensor, grid: BevGrid) -> Tensor:
        """Return decoded queries (K, width). Arguments as of `QueryStart`, and the queries (K, width)."""
        patches = box_patches(features, known.box, grid).view(len(query), PLACES**2, len(features))
        around = self.value(patches) + self.place
        valid = torch.ones(1, PLACES**2, dtype=torch.bool, device=query.device)
        for among, norm, across in zip(self.among, self.norms, self.across, strict=True):
            query = query + across(norm(query), around, valid)
            query = among(query, known.box[:, :2])
        return query


class InstanceHeads(nn.Module):
    """Refine score, class, box and velocity of instances by what they look like and how they move. It starts as is.

    Args:
        width: channels of an instance.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.classes = mlp(width, width, width, len(CLASS_NAMES))
        self.box = mlp(2 * width, width, width, 9)
        for each in (self.classes, self.box):
            start_as_zeros(each[-1])

    def logits(self, found: Instances, semantic: Tensor) -> Tensor:
        """Return the logits of classes (K, 9)."""
        rare = found.score.new_full((len(found), len(CLASS_NAMES)), RARE)
        stated = rare.scatter(1, found.label[:, None], logit(found.score)[:, None])
        refined: Tensor = stated + self.classes(semantic)
        return refined

    def boxes(self, found: Instances, semantic: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
        """Return boxes (K, 7) and velocities (K, 2); the network says shifts along and across the box."""
        change = self.box(torch.cat([semantic, motion], dim=1))
        cos, sin = found.box[:, 6].cos(), found.box[:, 6].sin()
        shift, speed = (
            torch.stack([cos * along - sin * across, sin * along + cos * across], dim=1)
            for along, across in (change[:, 0:2].T, change[:, 7:9].T)
        )
        size = found.box[:, 3:6] * change[:, 3:6].clamp(-1.0, 1.0).exp()
        place, rest = found.box[:, :2] + shift, [found.box[:, 2:3] + change[:, 2:3], size]
        return torch.cat([place, *rest, found.box[:, 6:] + change[:, 6:7]], dim=1), found.velocity + speed


RARE = -4.0
"""Logit of the classes that an instance is not stated to be of."""


def logit(score: Tensor) -> Tensor:
    """Return logits of scores, which are kept away from 0 and 1."""
    return torch.logit(score, eps=0.01)
