"""The fold of senders' instances into the receiver's, one sender after another."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from coopsim.geometry.assignment import Pairs
from coopsim.nn.queries.instance_decoder import logit
from coopsim.nn.queries.instances import Instances

_FADE_PER_S = 2.0
"""What the logit of a received score loses in each second of the message's delay."""


class InstanceFold:
    """A receiver's instances while those of senders are folded in.

    What a sender adds to an instance is added up beside it, and divided by the number of senders at the end. So all
    senders are compared with what the receiver itself knows, and their order does not matter for it. It matters for an
    object that several senders see and the receiver does not: the first of them stands for the receiver there.

    Args:
        own: N instances of the receiver.
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
        """Add a sender's aligned instances.

        Args:
            others: M instances.
            pairs: P rows of `known`, and of `others`.
            delay_s: age of the message.
            change: what the pairs add to semantic and motion, (P, D) each.
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
