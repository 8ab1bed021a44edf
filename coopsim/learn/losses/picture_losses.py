"""Losses of an encoder of pictures besides those of its head: depths, classes, and likeness to features of points."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.nn.camera.depth_bins import DepthBins
from coopsim.types.taxonomy import CLASS_NAMES

_ON_OBJECTS = 4.0
"""Weight of cells that show objects, which are few; that of the others is 1."""

_NEAR = 0.05
"""Heat from which a cell of a map counts as near an object."""


def depth_loss(logits: Tensor, depth_m: Tensor, label: Tensor, bins: DepthBins) -> Tensor:
    """Return the cross-entropy of predicted depths, a mean over cells.

    Args:
        logits: (M, K + 1, h, w).
        depth_m: (M, h, w) of the nearest surface in each cell; 0: nothing.
        label: (M, h, w) its class.
        bins: of depth.
    """
    each = -(bins.shares(depth_m) * logits.float().log_softmax(1)).sum(1)
    weight = torch.where(label < len(CLASS_NAMES), _ON_OBJECTS, 1.0)
    return (each * weight).sum() / weight.sum().clamp_min(1.0)


def label_loss(logits: Tensor, label: Tensor) -> Tensor:
    """Return the cross-entropy of predicted classes, a mean over cells.

    Args:
        logits: (M, 10, h, w).
        label: (M, h, w); all that is no `ObjectClass` counts as scenery.
    """
    target = label.long().clamp_max(len(CLASS_NAMES))
    weight = torch.where(target < len(CLASS_NAMES), _ON_OBJECTS, 1.0)
    each = functional.cross_entropy(logits.float(), target, reduction="none")
    return (each * weight).sum() / weight.sum().clamp_min(1.0)


def alike_loss(features: Tensor, of_points: Tensor, heat: Tensor) -> Tensor:
    """Return how far features near objects are from those of points, as a share of the energy of these.

    Features of pictures then mean what features of points mean: heads and fusions that know the one read the other.

    Args:
        features: (A, C, h, w) of pictures.
        of_points: (A, C, h, w) of the same agents' points.
        heat: (A, K, h, w) of objects that the pictures show.
    """
    near = heat.amax(1, keepdim=True) > _NEAR
    lost = ((features.float() - of_points.float()) ** 2 * near).sum()
    return lost / (of_points.float() ** 2 * near).sum().clamp_min(1.0)
