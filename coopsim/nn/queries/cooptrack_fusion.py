"""CoopTrack's fusion of agents (Zhong et al., ICCV 2025): align instances in two ways, match them on a graph,
aggregate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from coopsim.geometry.assignment import Pairs
from coopsim.geometry.se3 import SE3
from coopsim.nn.attention import DelayCode
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.attention import mlp
from coopsim.nn.queries.instance_fusion import RULE_M, GraphAssociation, InstanceFold, pairs_by_rule, sure_pairs
from coopsim.nn.queries.instances import Instances

_MOST_WEIGHT = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedInstances:
    """Instances of one sender, in its compass frame at capture, and the pose of that in the receiver's compass frame
    now.
    """

    instances: Instances
    receiver_SE3_sender: SE3
    delay_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ComparedInstances:
    """Association of one sender's instances, for its loss.

    Attributes:
        own: N instances of the receiver, and of earlier senders, as they were compared.
        others: M aligned instances.
        logits: (N, M) of being the same object.
    """

    own: Instances
    others: Instances
    logits: Tensor


class InstanceAggregation(nn.Module):
    """Make one instance of two, by networks that look at both. It starts as the mean of boxes and the own features."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.semantic, self.motion = mlp(2 * width, width, width), mlp(2 * width, width, width)
        self.weight = mlp(2 * width, width, 1)
        for net in (self.semantic, self.motion, self.weight):
            start_as_zeros(net[-1])

    def forward(self, own: Instances, theirs: Instances) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Return what P pairs add to semantic and motion, (P, D) each, and the weight (P, 1) of the others' boxes."""
        both = torch.cat([own.semantic, theirs.semantic], dim=1)
        moving = torch.cat([own.motion, theirs.motion], dim=1)
        log_weight = self.weight(both).clamp(-_MOST_WEIGHT, _MOST_WEIGHT)
        return (self.semantic(both), self.motion(moving)), log_weight.exp()


class CoopTrackFusion(nn.Module):
    """Fuse decoded instances of any number of senders. For ablations, three parts can be taken away.

    Args:
        width: channels of an instance.
        motion: False: instances are compared and aggregated by semantics alone.
        alignment: False: features stay as they were sent; boxes are aligned all the same.
        graph: False: instances are paired by distance.
    """

    before_decoding = False

    def __init__(self, width: int, *, motion: bool = True, alignment: bool = True, graph: bool = True) -> None:
        super().__init__()
        self.motion = motion
        self.align = LatentAlignment(width) if alignment else None
        self.associate = GraphAssociation(width) if graph else None
        self.aggregate = InstanceAggregation(width)

    def forward(
        self, own: Instances, received: Sequence[ReceivedInstances], least: float, most: int, *, by_rule: bool = False
    ) -> tuple[Instances, list[ComparedInstances]]:
        """Return the fused instances, the `most` surest, and the compared ones by sender.

        Args:
            own: decoded instances of the receiver.
            received: senders in the order in which they are fused.
            least: smallest affinity of a pair, in [0, 1]; above 1 no pair is made. Without a graph only that matters.
            most: number of instances of the result.
            by_rule: pair nearest centres, as in training; affinities are computed all the same.
        """
        fold, compared = InstanceFold(own), []
        for each in received:
            others = aligned_boxes(each.instances, each.receiver_SE3_sender, each.delay_s)
            if self.align is not None:
                others = self.align(others, each.receiver_SE3_sender, each.delay_s)
            logits = None
            if self.associate is not None:
                logits = self.associate(self._compared(fold.known), self._compared(others))
                compared.append(ComparedInstances(fold.known, others, logits))
            if logits is None or by_rule:
                pairs = pairs_by_rule(fold.known, others, RULE_M if least <= 1 else -1.0)
            else:
                pairs = sure_pairs(logits, least)
            self._fold(fold, others, pairs, each.delay_s)
        return fold.instances(most), compared

    def _fold(self, fold: InstanceFold, others: Instances, pairs: Pairs, delay_s: float) -> None:
        rows, columns = (torch.from_numpy(each).to(others.box.device) for each in pairs)
        own, theirs = self._compared(fold.known[rows]), self._compared(others[columns])
        (semantic, motion), weight = self.aggregate(own, theirs)
        fold.add(others, pairs, delay_s, (semantic, motion if self.motion else torch.zeros_like(motion)), weight)

    def _compared(self, known: Instances) -> Instances:
        """Return instances as they are compared: without motion where it is taken away."""
        return known if self.motion else replace(known, motion=torch.zeros_like(known.motion))


_FAR_M = 50.0
BLOCK = 16
"""Edge of the blocks of the latent rotation."""


def aligned_boxes(received: Instances, receiver_SE3_sender: SE3, delay_s: float) -> Instances:
    """Align explicitly: move boxes on by their velocities over the delay, and into the receiver's frame (P R^T + t)."""
    return received.advanced(delay_s).moved(receiver_SE3_sender)


class LatentAlignment(nn.Module):
    """Align implicitly: turn and shift features by the latent counterpart of the motion between two frames.

    With x an instance's features, out = x + proj(in(x) R^T + t + x), where R is a block-diagonal matrix and t a vector
    that two networks make of the explicit motion: R of the first two columns of the rotation (Zhou et al., CVPR 2019,
    six numbers that change continuously), t of the translation and the delay. R begins as the identity, t and proj as
    zeros. `BLOCK` divides the width.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.blocks = width // BLOCK
        self.turn, self.shift = mlp(6, width, width, self.blocks * BLOCK**2), mlp(3, width, width, width)
        self.delay = DelayCode(width)
        self.into = nn.ModuleDict({part: _layer(width) for part in _PARTS})
        self.out = nn.ModuleDict({part: nn.Sequential(_layer(width), nn.Linear(width, width)) for part in _PARTS})
        for net in (self.turn[-1], self.shift[-1], *(each[-1] for each in self.out.values())):  # type: ignore[index]
            start_as_zeros(net)

    def rotation(self, rotation: Tensor) -> Tensor:
        """Return the latent rotation's blocks (D / 16, 16, 16) for a rotation (3, 3)."""
        change = self.turn(rotation[:, :2].T.reshape(6)).view(self.blocks, BLOCK, BLOCK)
        turned: Tensor = torch.eye(BLOCK, device=change.device) + change
        return turned

    def forward(self, received: Instances, receiver_SE3_sender: SE3, delay_s: float) -> Instances:
        """Return the instances with aligned features; arguments as of `aligned_boxes`, boxes stay as they are."""
        like = received.semantic
        blocks = self.rotation(like.new_tensor(receiver_SE3_sender.rotation.tolist()))
        shift = self.shift(like.new_tensor(receiver_SE3_sender.translation.tolist()) / _FAR_M)
        tokens = shift.expand(2, 1, 1, -1)  # of which the second one is the message's
        shift = self.delay(tokens, like.new_tensor([delay_s]))[1, 0, 0]
        made = {}
        for part in _PARTS:
            given = getattr(received, part)
            inner = self.into[part](given).view(-1, self.blocks, BLOCK)
            turned = torch.einsum("kbj,bij->kbi", inner, blocks).flatten(1)
            made[part] = given + self.out[part](turned + shift + given)
        return replace(received, **made)


_PARTS = ("semantic", "motion")


def _layer(width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(width, width), nn.LayerNorm(width), nn.ReLU())
