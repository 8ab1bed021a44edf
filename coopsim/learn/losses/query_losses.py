"""Losses of instance queries: classes and boxes of what is found, and which instances of two agents are one object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.assignment import hungarian
from coopsim.nn.detector.decode import GROUPS
from coopsim.nn.queries.cooptrack_fusion import ComparedInstances
from coopsim.nn.queries.instance_pairs import IMPOSSIBLE
from coopsim.nn.queries.instances import Instances
from coopsim.types.taxonomy import ObjectClass

LABEL_REACH_M = 3.0
"""An instance is of the object whose centre is the nearest within this, seen from above."""

_FAST_M_S = 10.0
_VELOCITY = 0.2
"""Weight of the two numbers of the velocity; those of the others are 1."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueObjects:
    """The objects around an agent in a frame, in its compass frame.

    Attributes:
        box: (N, 7).
        velocity: (N, 2) m/s.
        label: (N,) int64.
        shown: (N,) bool, the objects that are to be found; who finds one of the others is neither right nor wrong.
    """

    box: Tensor
    velocity: Tensor
    label: Tensor
    shown: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class LabelledInstances:
    """Which object each instance is.

    Attributes:
        rows: (P,) instances of an object.
        objects: (P,) the objects.
    """

    rows: Tensor
    objects: Tensor

    def by_row(self, count: int) -> Tensor:
        """Return the object of each of `count` instances, (count,); -1: none."""
        found = torch.full((count,), -1, dtype=torch.int64)
        found[self.rows] = self.objects
        return found


def labelled(known: Instances, truth: TrueObjects) -> LabelledInstances:
    """Match instances with objects of their group of classes by the distances of their centres (Hungarian)."""
    away = torch.cdist(known.box[:, :2].detach(), truth.box[:, :2]).double().numpy()
    group, others = _GROUP_OF[known.label.numpy()], _GROUP_OF[truth.label.numpy()]
    possible = (away <= LABEL_REACH_M) & (group[:, None] == others)
    rows, objects = hungarian(np.where(possible, -away, -np.inf), -np.inf)
    return LabelledInstances(torch.from_numpy(rows), torch.from_numpy(objects))


def instance_losses(
    known: Instances, logits: Tensor, truth: TrueObjects, labels: LabelledInstances
) -> dict[str, Tensor]:
    """Return the losses of instances by name, for each object that is to be found.

    Classes have `class_loss`, boxes L1 of x, y, z (m), logs of sizes, sine of the yaw's error, and velocity (10 m/s).

    Args:
        known: K refined instances.
        logits: (K, 9) of their classes.
        truth: the objects.
        labels: which is which.
    """
    shown = truth.shown[labels.objects]
    rows, objects = labels.rows[shown], labels.objects[shown]
    box, true = known.box[rows], truth.box[objects]
    errors = torch.cat(
        [
            (box[:, :3] - true[:, :3]).abs(), torch.log(box[:, 3:6] / true[:, 3:6]).abs(),
            torch.sin(box[:, 6:] - true[:, 6:]).abs(),
            _VELOCITY * (known.velocity[rows] - truth.velocity[objects]).abs() / _FAST_M_S,
        ],
        dim=1,
    )  # fmt: skip
    return {"instance class": class_loss(logits, truth, labels), "instance box": errors.sum() / max(len(rows), 1)}


def class_loss(logits: Tensor, truth: TrueObjects, labels: LabelledInstances) -> Tensor:
    """Return the focal loss (Lin et al., ICCV 2017, alpha 0.25, gamma 2) of classes, for each object to be found.

    Args:
        logits: (K, 9) of the classes of K instances.
        truth: the objects; instances of those that are not to be found do not count.
        labels: which is which.
    """
    shown = truth.shown[labels.objects]
    rows, objects = labels.rows[shown], labels.objects[shown]
    counted = torch.ones(len(logits), dtype=torch.bool)
    counted[labels.rows[~shown]] = False
    target = torch.zeros_like(logits)
    target[rows, truth.label[objects]] = 1.0
    return focal_loss(logits, target, alpha=0.25, gamma=2.0)[counted].sum() / max(len(rows), 1)


def association_loss(compared: ComparedInstances, own: LabelledInstances, others: LabelledInstances) -> Tensor:
    """Return the focal loss (alpha 0.5, gamma 1) of pairs of instances, which are one object or not, per such pair."""
    mine, theirs = own.by_row(len(compared.own)), others.by_row(len(compared.others))
    same = (mine[:, None] == theirs) & (mine >= 0)[:, None]
    near = compared.logits > IMPOSSIBLE
    loss = focal_loss(compared.logits[near], same[near].float(), alpha=0.5, gamma=1.0)
    return loss.sum() / max(int((same & near).sum()), 1)


def focal_loss(logits: Tensor, target: Tensor, alpha: float, gamma: float) -> Tensor:
    """Return the focal loss of each logit, whose target is 0 or 1 (Lin et al., eq. 5)."""
    right = torch.where(target > 0.5, logits, -logits)
    weight = torch.where(target > 0.5, alpha, 1 - alpha)
    return -weight * (1 - right.sigmoid()) ** gamma * functional.logsigmoid(right)


_GROUP_OF = np.array([next(k for k, group in enumerate(GROUPS) if cls in group) for cls in ObjectClass])
