"""CoopTrack's cooperation (Zhong et al., ICCV 2025): decoded instances are aligned, matched on a graph, aggregated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from coopsim.geometry.assignment import Pairs
from coopsim.geometry.se3 import SE3
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.instance_attention import mlp
from coopsim.nn.queries.instance_fold import InstanceFold
from coopsim.nn.queries.instance_pairs import RULE_M, GraphAssociation, pairs_by_rule, sure_pairs
from coopsim.nn.queries.instances import Instances
from coopsim.nn.queries.query_alignment import LatentAlignment, aligned_boxes

_MOST_WEIGHT = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedInstances:
    """What one sender sent.

    Attributes:
        instances: M, in the sender's compass frame at capture.
        receiver_SE3_sender: of that frame, in the receiver's compass frame now.
        delay_s: age of the message.
    """

    instances: Instances
    receiver_SE3_sender: SE3
    delay_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ComparedInstances:
    """What an association made of one sender's instances, for its loss.

    Attributes:
        own: N instances of the receiver, and of earlier senders, as they were compared.
        others: M aligned instances.
        logits: (N, M) of being the same object.
    """

    own: Instances
    others: Instances
    logits: Tensor


class InstanceAggregation(nn.Module):
    """Make one instance of two, by networks that look at both. It starts as the mean of boxes and the own features.

    Args:
        width: channels of an instance.
    """

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
    """Fuse decoded instances of any number of senders.

    The last three arguments each take away one part, for ablations.

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
        """Return the fused instances, and what was compared, by sender.

        Args:
            own: of the receiver, decoded.
            received: of the senders, in the order in which they are folded in.
            least: smallest affinity of a pair, in [0, 1]; above 1 no pair is made. Without a graph only that matters.
            most: instances of the result; the surest stay.
            by_rule: pairs are those of nearest centres, as in training; affinities are computed all the same.
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
