"""Losses of a head: heat of centres, codes of boxes and their variances; with images also depths and classes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.errors import UnknownNameError
from coopsim.learn.losses.judge_losses import judge_losses
from coopsim.learn.losses.own_losses import OwnLosses, losses_of
from coopsim.learn.samples.targets import Targets
from coopsim.nn.camera.picture_net import DepthBins
from coopsim.nn.detector.detector_net import (
    AXIS,
    HEADING,
    HEIGHT,
    LOG_VARIANCE,
    OFFSET,
    SIZE,
    VELOCITY,
    CentreHead,
    JudgedHead,
    at_cells,
    residuals,
)
from coopsim.types.taxonomy import CLASS_NAMES

WEIGHTS = {
    "velocity": 0.1, "variance": 0.05, "sure": 0.3, "foreground": 0.3, "teacher": 10.0, "alike": 0.5,
    "unmoved": 0.0, "instance class": 2.0, "instance box": 0.25, "association": 10.0,
    "detection class": 2.0, "prediction class": 2.0, "xiou": 2.0, "giou": 0.0, "speed": 0.25, "turn": 0.5,
    "front": 0.5, "fit": 0.5,
}  # fmt: skip
"""Weights of the parts of the loss; those of the others are 1."""


def head_loss(
    head: CentreHead | JudgedHead, features: Tensor, targets: Targets, own: OwnLosses = MappingProxyType({})
) -> dict[str, Tensor]:
    """Return the parts of the loss of a head on features (B, C, h, w), by name.

    Parts of users, `own`, come last.
    """
    shared, logits = head.heat(features)
    parts = {"heat": heat_loss(logits, targets.heat, targets.objects, targets.ignored)}
    parts |= code_losses(head.codes(at_cells(shared, targets.cell)), targets)
    if isinstance(head, JudgedHead):
        parts |= judge_losses(head, features, shared, logits, targets)
    return parts | losses_of(own, head, features, targets)


def heat_loss(logits: Tensor, heat: Tensor, objects: int, ignored: Tensor | None = None) -> Tensor:
    """Return the focal loss of heat (B, K, h, w), less for cells near a centre, per object.

    CenterPoint's (Yin et al., section 3; Law and Deng, "CornerNet", eq. 1) with alpha 2 and beta 4. Cells that are
    `ignored`, (B, h, w), do not count.
    """
    hot = heat == 1
    cold = ~hot if ignored is None else ~(hot | ignored[:, None])
    log_p, log_q = functional.logsigmoid(logits), functional.logsigmoid(-logits)
    p = logits.sigmoid()
    found = (log_p * (1 - p) ** 2)[hot].sum()
    empty = (log_q * p**2 * (1 - heat) ** 4 * cold).sum()
    return -(found + empty) / max(objects, 1)


def code_losses(code: Tensor, targets: Targets) -> dict[str, Tensor]:
    """Return the losses of codes (M, 19): smooth L1 of the values, and the Gaussian likelihood of their errors.

    Each is a mean over cells by their heat; that of velocities is one over cells whose sample shows motion. Gradients
    of the likelihood reach the log variances alone, so that a large variance does not excuse a bad box.
    """
    weight, true = targets.weight, targets.code

    def mean(each: Tensor, weight: Tensor = weight) -> Tensor:
        return (each * weight).sum() / weight.sum().clamp(min=1.0)

    def loss(part: slice, weight: Tensor = weight) -> Tensor:
        error = functional.smooth_l1_loss(code[:, part], true[:, part], reduction="none", beta=0.1)
        return mean(error.sum(dim=1), weight)

    error = residuals(code, true, targets.yaw, targets.cell_m).detach()
    spread = code[:, LOG_VARIANCE].clamp(-8.0, 4.0)
    likelihood = 0.5 * (spread + error**2 * torch.exp(-spread)).sum(dim=1)
    return {
        "place": 2 * loss(OFFSET) + loss(HEIGHT), "size": loss(SIZE), "yaw": loss(AXIS) + 0.5 * loss(HEADING),
        "velocity": loss(VELOCITY, weight * targets.moves), "variance": mean(likelihood),
    }  # fmt: skip


def sum_of(parts: Mapping[str, Tensor], weights: Mapping[str, float] | None = None) -> Tensor:
    """Return the sum of the parts, by `weights` or else `WEIGHTS`; parts without a weight count once.

    Raises:
        UnknownNameError: there is a weight for no part.
    """
    for name in weights or ():
        if name not in parts:
            raise UnknownNameError("part of the loss", name, parts)
    known = {**WEIGHTS, **(weights or {})}
    return torch.stack([known.get(name, 1.0) * part for name, part in parts.items()]).sum()


_ON_OBJECTS = 4.0
"""Weight of cells that show objects, which are few; that of the others is 1."""

_NEAR = 0.05
"""Heat from which a cell of a map counts as near an object."""


def depth_loss(logits: Tensor, depth_m: Tensor, label: Tensor, bins: DepthBins) -> Tensor:
    """Return the cross-entropy of depths, a mean over cells.

    Args:
        logits: (M, K + 1, h, w) logits of the bins.
        depth_m: (M, h, w) depth of the nearest surface in each cell; 0: nothing.
        label: (M, h, w) class of that surface.
        bins: the K bins.
    """
    each = -(bins.shares(depth_m) * logits.float().log_softmax(1)).sum(1)
    weight = torch.where(label < len(CLASS_NAMES), _ON_OBJECTS, 1.0)
    return (each * weight).sum() / weight.sum().clamp_min(1.0)


def label_loss(logits: Tensor, label: Tensor) -> Tensor:
    """Return the cross-entropy of classes (M, 10, h, w), a mean over cells; labels that are no class are scenery."""
    target = label.long().clamp_max(len(CLASS_NAMES))
    weight = torch.where(target < len(CLASS_NAMES), _ON_OBJECTS, 1.0)
    each = functional.cross_entropy(logits.float(), target, reduction="none")
    return (each * weight).sum() / weight.sum().clamp_min(1.0)


def alike_loss(features: Tensor, of_points: Tensor, heat: Tensor) -> Tensor:
    """Return the distance of images' features from those of points near objects, as a share of the energy of these.

    Features of images then mean what features of points mean: heads and fusions that know the one read the other.

    Args:
        features: (A, C, h, w) maps of images.
        of_points: (A, C, h, w) maps of the same agents' points.
        heat: (A, K, h, w) heat of objects that the images show.
    """
    near = heat.amax(1, keepdim=True) > _NEAR
    lost = ((features.float() - of_points.float()) ** 2 * near).sum()
    return lost / (of_points.float() ** 2 * near).sum().clamp_min(1.0)
