"""Which instances of two agents are the same object: by a learned graph, or by distance."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.nn.queries.instance_attention import mlp
from coopsim.nn.queries.instances import Instances

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
    points. With q and k what the nodes are multiplied by,

        A = sigmoid(FFN(q k^T / sqrt(D) + E W))

    where the product, one number, is added to all D channels of the edge. Whose nodes are which side's is all that
    tells the agents apart, so any number of senders is compared in turn. Affinities start as those of the rule: one
    half at `RULE_M`, more for what is nearer; FFN learns what differs from it.

    Args:
        width: D, channels of an instance.
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
    """Return the pairs of nearest centres whose distance along each axis is at most the own box's size (UniV2X).

    Axes are those of the own box, so a pair's fate does not depend on which way the world is turned.

    Args:
        own: N instances; those with a smaller score than `least_score` are matched with none.
        others: M aligned instances of a sender.
        least_score: as above.
    """
    apart = (others.box[None, :, :3] - own.box[:, None, :3]).detach()
    cos, sin = own.box[:, 6:].cos().detach(), own.box[:, 6:].sin().detach()
    along, across = cos * apart[..., 0] + sin * apart[..., 1], cos * apart[..., 1] - sin * apart[..., 0]
    inside = (torch.stack([along, across, apart[..., 2]], dim=-1).abs() <= own.box[:, None, 3:6]).all(-1)
    inside &= (own.score >= least_score)[:, None]
    away = apart.norm(dim=-1)
    return hungarian(torch.where(inside, -away, -torch.inf).double().cpu().numpy(), -np.inf)
