"""Matching of two agents' instances, by a learned graph, by distance or by the box's size, and their fusion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.attention import mlp
from coopsim.nn.queries.instances import Instances, logit

REACH_M = 10.0
"""Farther apart, no two instances are one object, whatever a network makes of them."""

RULE_M = 3.5
"""Reach of the rule that stands in for the network while it is trained."""

IMPOSSIBLE = -1e4
"""Logit of a pair that is farther apart."""

_EDGE_M = 5.0


class GraphAssociation(nn.Module):
    """Compare all instances of two agents on a graph between them (CoopTrack's GBA).

    Nodes are made of semantics and motions, by networks of each side's own, edges of the difference of the reference
    points. With q and k the projected nodes,

        A = sigmoid(FFN(q k^T / sqrt(D) + E W))

    where the product, one number, is added to all D channels of the edge. Agents are told apart by side alone, so any
    number of senders is compared in turn. Affinities start as those of the rule: one half at `RULE_M`, more for nearer
    ones; FFN learns the difference from it.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.own, self.others = mlp(2 * width, width, width), mlp(2 * width, width, width)
        self.query, self.key = nn.Linear(width, width, bias=False), nn.Linear(width, width, bias=False)
        self.edge, self.mix = mlp(3, width, width), nn.Linear(width, width, bias=False)
        self.judge = mlp(width, width, 1)
        start_as_zeros(self.judge[-1])

    def forward(self, own: Instances, others: Instances) -> Tensor:
        """Return logits (N, M) of N own and M aligned instances of a sender to be the same object."""
        query = self.query(self.own(torch.cat([own.semantic, own.motion], dim=1)))
        key = self.key(self.others(torch.cat([others.semantic, others.motion], dim=1)))
        alike = query @ key.T / query.shape[1] ** 0.5
        apart = own.box[:, None, :3] - others.box[None, :, :3]
        rows, columns = torch.nonzero(apart.norm(dim=-1) <= REACH_M, as_tuple=True)
        edges = self.mix(self.edge(apart[rows, columns] / _EDGE_M))
        by_rule = RULE_M - apart[rows, columns, :2].norm(dim=-1)
        near = by_rule + self.judge(alike[rows, columns][:, None] + edges)[:, 0]
        return torch.full_like(alike, IMPOSSIBLE).index_put((rows, columns), near)


def sure_pairs(logits: Tensor, least: float) -> Pairs:
    """Return the best pairs by logits (N, M) whose affinity reaches `least`: Hungarian on 1 - A, then the threshold."""
    return hungarian(logits.sigmoid().detach().double().cpu().numpy(), least)


def pairs_by_rule(own: Instances, others: Instances, reach_m: float = RULE_M) -> Pairs:
    """Return the pairs of nearest centres, seen from above, that are within a reach: what training aggregates by."""
    away = torch.cdist(own.box[:, :2].detach(), others.box[:, :2].detach()).double().cpu().numpy()
    return hungarian(np.where(away <= reach_m, reach_m - away, -np.inf), 0.0)


def pairs_by_gate(own: Instances, others: Instances, least_score: float) -> Pairs:
    """Return the pairs of nearest centres whose distance along each axis of the own box is at most its size (UniV2X).

    Own instances with a smaller score than `least_score` are matched with none.
    """
    apart = (others.box[None, :, :3] - own.box[:, None, :3]).detach()
    cos, sin = own.box[:, 6:].cos().detach(), own.box[:, 6:].sin().detach()
    along, across = cos * apart[..., 0] + sin * apart[..., 1], cos * apart[..., 1] - sin * apart[..., 0]
    inside = (torch.stack([along, across, apart[..., 2]], dim=-1).abs() <= own.box[:, None, 3:6]).all(-1)
    inside &= (own.score >= least_score)[:, None]
    away = apart.norm(dim=-1)
    return hungarian(torch.where(inside, -away, -torch.inf).double().cpu().numpy(), -np.inf)


_FADE_PER_S = 2.0
"""What the logit of a received score loses in each second of the message's delay."""


class InstanceFold:
    """Accumulator of a receiver's instances while those of senders are fused in.

    What a sender adds to an instance is summed beside it, and divided by the number of senders at the end. So all
    senders are compared with the receiver's own instances, and their order does not matter for these. It matters for an
    object that several senders see and the receiver does not: the first of them stands for the receiver there.
    """

    def __init__(self, own: Instances) -> None:
        self.known = own
        self._semantic, self._motion = torch.zeros_like(own.semantic), torch.zeros_like(own.motion)
        self._senders, self._weight = own.score.new_zeros(len(own), 1), own.score.new_ones(len(own), 1)
        self._box, self._velocity = torch.zeros_like(own.box), torch.zeros_like(own.velocity)
        self._score, self._label, self._heard = own.score, own.label, torch.zeros_like(own.hits)

    def add(
        self, others: Instances, pairs: Pairs, delay_s: float, change: tuple[Tensor, Tensor], weight: Tensor | None
    ) -> None:
        """Add a sender's M aligned instances.

        Args:
            others: M instances.
            pairs: P rows of `known`, and of `others`.
            delay_s: age of the message.
            change: additions to semantic and motion, (P, D) each.
            weight: (P, 1) of their boxes against the receiver's, whose is 1; None: the receiver's boxes stay.
        """
        device = others.box.device
        rows, columns = (torch.from_numpy(each).to(device) for each in pairs)
        theirs, base = others[columns], self.known[rows]
        believed = torch.sigmoid(logit(others.score) - _FADE_PER_S * delay_s)
        self._semantic, self._motion = (
            total.index_add(0, rows, each) for total, each in zip((self._semantic, self._motion), change, strict=True)
        )
        self._senders = self._senders.index_add(0, rows, torch.ones_like(rows, dtype=self._senders.dtype)[:, None])
        self._heard = self._heard.index_add(0, rows, torch.ones_like(rows))
        if weight is not None:
            self._weight = self._weight.index_add(0, rows, weight)
            self._box = self._box.index_add(0, rows, weight * _apart(theirs.box, base.box))
            self._velocity = self._velocity.index_add(0, rows, weight * (theirs.velocity - base.velocity))
        surer = believed[columns] > self._score[rows]
        self._score = self._score.index_copy(0, rows, torch.where(surer, believed[columns], self._score[rows]))
        self._label = self._label.index_copy(0, rows, torch.where(surer, theirs.label, self._label[rows]))
        self._append(others, columns, believed)

    def _append(self, others: Instances, columns: Tensor, believed: Tensor) -> None:
        """Add what the receiver has not."""
        alone = torch.ones(len(others), dtype=torch.bool, device=columns.device)
        alone[columns] = False
        new = replace(others, score=believed)[alone]
        self.known = Instances.joined([self.known, new])
        for name, of_new in (
            ("_semantic", torch.zeros_like(new.semantic)), ("_motion", torch.zeros_like(new.motion)),
            ("_senders", new.score.new_zeros(len(new), 1)), ("_weight", new.score.new_ones(len(new), 1)),
            ("_box", torch.zeros_like(new.box)), ("_velocity", torch.zeros_like(new.velocity)),
            ("_score", new.score), ("_label", new.label), ("_heard", torch.zeros_like(new.hits)),
        ):  # fmt: skip
            setattr(self, name, torch.cat([getattr(self, name), of_new]))

    def instances(self, most: int) -> Instances:
        """Return the instances with all that was added: the `most` surest, so that new ones replace the least sure."""
        known, senders = self.known, self._senders.clamp_min(1.0)
        box, heard = known.box + self._box / self._weight, self._heard > 0
        # Who saw an object once does not know its velocity: that of the others counts alone.
        strange = known.hits == 1
        others = (self._weight - 1.0).clamp_min(1e-6)
        velocity = known.velocity + self._velocity / torch.where(strange[:, None], others, self._weight)
        return replace(
            known, box=box, velocity=velocity, score=self._score, label=self._label,
            semantic=known.semantic + self._semantic / senders, motion=known.motion + self._motion / senders,
            hits=torch.where(heard, known.hits.clamp_min(2), known.hits),
            missed=torch.where(heard, 0, known.missed),
        ).surest(most)  # fmt: skip


def _apart(theirs: Tensor, own: Tensor) -> Tensor:
    """Return by what boxes (P, 7) differ; a box is the same turned by half a turn, so yaws differ by less than half."""
    apart = theirs - own
    yaw = torch.remainder(apart[:, 6:] + torch.pi / 2, torch.pi) - torch.pi / 2
    return torch.cat([apart[:, :6], yaw], dim=1)
