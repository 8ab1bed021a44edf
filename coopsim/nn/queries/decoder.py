"""Decoder of instance queries: from a map, the known instances and their neighbours to refined instances."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from coopsim.nn.attention import normed_layers
from coopsim.nn.covariance.covariance_net import PLACES, box_patches
from coopsim.nn.detector.detector_net import size_priors
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.attention import AmongInstances, InstanceAttention, mlp
from coopsim.nn.queries.instances import Instances, logit
from coopsim.types import BevGrid
from coopsim.types.taxonomy import CLASS_NAMES

_CORNERS = torch.tensor([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FAST_M_S = 10.0


class MotionFeatures(nn.Module):
    """Encode a box's eight corners, seen from its middle, as a set of points, and its heading and velocity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.corners, self.speed = (nn.Sequential(*normed_layers(inputs, width, width, width)) for inputs in (3, 4))
        self.join = nn.Sequential(*normed_layers(2 * width, width))

    def forward(self, box: Tensor, velocity: Tensor) -> Tensor:
        """Return (K, width) of boxes (K, 7) and velocities (K, 2) m/s."""
        yaw = box[:, 6]
        speed = torch.column_stack([yaw.cos(), yaw.sin(), velocity / _FAST_M_S])
        shape = self.corners(corners(box)).amax(1)
        features: Tensor = self.join(torch.cat([shape, self.speed(speed)], dim=1))
        return features


def corners(box: Tensor) -> Tensor:
    """Return the corners (K, 8, 3) m of boxes (K, 7), seen from their middles."""
    x, y, z = (box[:, None, 3:6] * _CORNERS.to(box)).unbind(-1)
    cos, sin = box[:, 6:].cos(), box[:, 6:].sin()
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


_FAR_M, _HIGH_M, _LOGIT, _FRAMES = 50.0, 2.0, 4.0, 4.0
_NUMBERS = 12


class BoxEmbedding(nn.Module):
    """Make a vector of an object's size, heading, motion, height, range, score, class and age.

    Of its place around the agent only the range counts, so that every direction is alike.
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
    """Make queries of instances: from an agent's map at the object, its box, and its features of the frame before."""

    def __init__(self, features: int, width: int) -> None:
        super().__init__()
        self.look = nn.Linear(features * PLACES**2, width)
        self.embed = BoxEmbedding(width)
        self.carry = nn.Linear(width, width, bias=False)
        self.norm = nn.LayerNorm(width)

    def forward(self, known: Instances, features: Tensor, grid: BevGrid) -> Tensor:
        """Return queries (K, width) of instances at their reference points, from an agent's map (C, h, w). Semantics
        are those of the frame before, zero for new ones.
        """
        seen = self.look(box_patches(features, known.box, grid))
        query: Tensor = self.norm(seen + self.embed(known) + self.carry(known.semantic))
        return query


class InstanceDecoder(nn.Module):
    """Let queries attend to each other and to the map around their reference points, layer by layer.

    Cross-attention reads the map at nine places in and around the box, as deformable attention reads it at a few (Zhu
    et al., "Deformable DETR", ICLR 2021, eq. 2), here at places that the box gives.
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
    """Refine score, class, box and velocity of instances by what they look like and how they move. It starts as is."""

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
