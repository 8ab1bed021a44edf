"""Losses of integrated detection and tracking: of the detection branch, and of the prediction branch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.learn.losses.overlap_losses import giou_of_pairs
from coopsim.learn.losses.query_losses import LabelledInstances, TrueObjects, class_loss, labelled
from coopsim.nn.integrated.integrated_net import IntegratedStep
from coopsim.nn.queries.instances import Instances

_FAST_M_S = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class TaughtFrame:
    """One frame of one receiver, with what is to be found in it.

    Attributes:
        step: what the network makes of it.
        truth: the objects around the receiver.
        same: which object each track of the frame before is; tracks of what is no object, or has left, are of none.
    """

    step: IntegratedStep
    truth: TrueObjects
    same: LabelledInstances


def frame_losses(taught: TaughtFrame) -> dict[str, Tensor]:
    """Return the losses of a frame by name.

    Classes have the focal loss, in which s_t is to be high for tracks whose object somebody sees now. Boxes have 1 -
    XIOU ("xiou") or, for comparison, 1 - (GIoU + 1) / 2 ("giou"), which is the same but for headings; velocities L1
    (10 m/s). Whether to turn a box around is taught by cross entropy ("turn"). Predicted boxes are taught for hidden
    objects, too.
    """
    step, truth = taught.step, taught.truth
    labels = labelled(step.detected, truth)
    shown = truth.shown[labels.objects]
    found = LabelledInstances(labels.rows[shown], labels.objects[shown])
    parts = {
        "detection class": class_loss(step.detected_logits, truth, labels),
        "prediction class": _seen_loss(step.predicted_logits, taught),
    }
    branches = ((step.detected, step.detected_turn, found), (step.predicted, step.predicted_turn, taught.same))
    for known, turn, pairs in branches:
        for name, part in _box_losses(known, turn, truth, pairs).items():
            parts[name] = parts.get(name, 0.0) + part
    return parts


def _seen_loss(logits: Tensor, taught: TaughtFrame) -> Tensor:
    """Return the focal loss of predictions: those of hidden objects are to be of no class, for nobody sees these."""
    seen = taught.truth.shown[taught.same.objects]
    same = LabelledInstances(taught.same.rows[seen], taught.same.objects[seen])
    return class_loss(logits, taught.truth, same)


def _box_losses(known: Instances, turn: Tensor, truth: TrueObjects, pairs: LabelledInstances) -> dict[str, Tensor]:
    total = max(len(pairs.rows), 1)
    box, true = known.box[pairs.rows], truth.box[pairs.objects]
    giou = (giou_of_pairs(box, true) + 1) / 2
    agree = (torch.cos(box[:, 6] - true[:, 6]) + 1) / 2
    apart = (known.velocity[pairs.rows] - truth.velocity[pairs.objects]).abs() / _FAST_M_S
    logits = turn[pairs.rows]
    asked = box[:, 6].detach() - torch.pi * (logits > 0)
    wrong = (torch.cos(asked - true[:, 6]) < 0).to(logits)
    turned = functional.binary_cross_entropy_with_logits(logits, wrong, reduction="sum")
    errors = {"xiou": 1 - giou * agree, "giou": 1 - giou, "speed": apart, "turn": turned}
    return {name: each.sum() / total for name, each in errors.items()}
