"""The loss of the anchor head: focal on which anchors are objects, smooth L1 on their boxes, direction beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.learn.losses.anchor_targets import AnchorAssignment, AnchorTargets, anchor_targets, join_anchor_targets
from coopsim.learn.losses.losses import sum_of
from coopsim.nn.detector.anchor_head import AnchorHead, AnchorMaps
from coopsim.nn.detector.anchors import CODE
from coopsim.nn.detector.decode import GROUPS
from coopsim.support.checks import require_between, require_non_negative, require_positive
from coopsim.types import BevGrid, Ints


@dataclass(frozen=True, slots=True)
class AnchorLossConfig:
    """Weights of the anchor head's loss. The defaults are OpenCOOD's; HEAL's `positive_weight` is 2.

    Attributes:
        alpha: of the focal loss: weight of objects; that of empty anchors is 1 - alpha.
        gamma: of the focal loss: how much less sure anchors count.
        positive_weight: further weight of objects.
        box_weight: of the smooth L1 loss.
        beta: error of a number from which the loss is linear.
        direction_weight: of the direction's cross entropy, where the head has the classifier.
    """

    alpha: float = 0.25
    gamma: float = 2.0
    positive_weight: float = 1.0
    box_weight: float = 2.0
    beta: float = 1 / 9
    direction_weight: float = 0.2

    def __post_init__(self) -> None:
        require_between(0, 1, alpha=self.alpha)
        require_non_negative(gamma=self.gamma, box_weight=self.box_weight, direction_weight=self.direction_weight)
        require_positive(positive_weight=self.positive_weight, beta=self.beta)


OPENCOOD = AnchorLossConfig(), AnchorAssignment()
"""How a head without direction classifier is taught: as OpenCOOD's."""

HEAL = AnchorLossConfig(positive_weight=2.0), AnchorAssignment(between="ignored")
"""How a head with direction classifier is taught: as HEAL's."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The objects that a sample shows.

    Attributes:
        boxes: (N, 7) in the frame of the grid.
        label: (N,)
        grid: the cells of the features.
    """

    boxes: Floats
    label: Ints
    grid: BevGrid


def anchor_head_loss(head: AnchorHead, features: Tensor, truth: Sequence[Truth]) -> dict[str, Tensor]:
    """Return the loss of a head on features (B, C, h, w): "loss", the sum, and its parts by name.

    All vehicles are one class; other objects are background.
    """
    config, assignment = HEAL if head.direction else OPENCOOD
    vehicles = [each.boxes[np.isin(each.label, GROUPS[0])] for each in truth]
    targets = [
        anchor_targets(boxes, each.grid, head.config, assignment) for boxes, each in zip(vehicles, truth, strict=True)
    ]
    parts = anchor_loss(head(features), join_anchor_targets(targets).to(features.device), config)
    return {"loss": sum_of(parts), **parts}


def anchor_loss(maps: AnchorMaps, targets: AnchorTargets, config: AnchorLossConfig | None = None) -> dict[str, Tensor]:
    """Return the weighted parts of the loss of the head's maps, means over samples.

    In each sample they are divided by the number of anchors that are objects, at least 1.

    Args:
        maps: of B samples.
        targets: of the same samples and grid.
        config: weights; None: the defaults.

    Raises:
        InvalidValueError: the shapes differ.
    """
    weights = config or AnchorLossConfig()
    if targets.role.shape != maps.logits.shape:
        raise InvalidValueError(
            f"targets are of (samples, anchors, rows, columns) {tuple(targets.role.shape)}, "
            f"the head's maps of {tuple(maps.logits.shape)}"
        )
    share = 1 / (targets.role == 1).flatten(1).sum(dim=1).clamp(min=1) / len(targets.role)
    heat = (_focal(maps.logits, targets.role, weights).flatten(1).sum(dim=1) * share).sum()
    of_object = share[targets.index // targets.role[0].numel()]
    codes = maps.codes.movedim(2, -1).reshape(-1, CODE)[targets.index]
    box = (_box_error(codes, targets.codes, weights.beta) * of_object).sum() * weights.box_weight
    parts = {"heat": heat, "box": box}
    if maps.backwards is not None:
        sides = maps.backwards.movedim(2, -1).reshape(-1, 2)[targets.index]
        wrong = functional.cross_entropy(sides, targets.backwards.long(), reduction="none")
        parts["direction"] = (wrong * of_object).sum() * weights.direction_weight
    return parts


def _focal(logits: Tensor, role: Tensor, config: AnchorLossConfig) -> Tensor:
    """Return the focal loss (B, A, h, w) (Lin et al., ICCV 2017, eq. 5), 0 where anchors are not counted."""
    wanted = (role == 1).to(logits.dtype)
    entropy = functional.binary_cross_entropy_with_logits(logits, wanted, reduction="none")
    unsure = (wanted - torch.sigmoid(logits)).abs() ** config.gamma
    weight = wanted * config.alpha * config.positive_weight + (1 - wanted) * (1 - config.alpha)
    return weight * unsure * entropy * (role >= 0)


def _box_error(codes: Tensor, wanted: Tensor, beta: float) -> Tensor:
    """Return the smooth L1 error (P,), of headings by the sine of their difference (SECOND, eq. 5)."""
    plain = functional.smooth_l1_loss(codes[:, :6], wanted[:, :6], beta=beta, reduction="none").sum(dim=1)
    turn = torch.sin(codes[:, 6] - wanted[:, 6])
    return plain + functional.smooth_l1_loss(turn, torch.zeros_like(turn), beta=beta, reduction="none")
