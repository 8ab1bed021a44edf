"""Losses of the second look at boxes: which end is the front, and how well a box fits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.iou import iou_bev
from coopsim.learn.samples.targets import Targets
from coopsim.nn.detector.box_judge import patches_of
from coopsim.nn.detector.decode import GROUP_OF_LABEL, cell_centers, find_peaks
from coopsim.nn.detector.detector_net import CentreHead, JudgedHead, at_cells, decode_boxes
from coopsim.types import BevGrid

_LEAST_SCORE, _MOST = 0.03, 48
"""Peaks that are looked at: of this heat, and so many of a map."""

_SAME_IOU = 0.3
"""BEV IoU with a true box from which a found one has a right way round."""


def judge_losses(
    head: JudgedHead, features: Tensor, shared: Tensor, logits: Tensor, targets: Targets
) -> dict[str, Tensor]:
    """Return the losses "front" and "fit" of a head's judge on the boxes that the head finds in its maps now.

    Both are cross entropies; boxes near objects that hardly show are left out.

    Args:
        head: the head.
        features: (B, C, h, w) its features.
        shared: (B, C, h, w) its shared features.
        logits: (B, 9, h, w) its heat.
        targets: targets of the maps.
    """
    seen = found_boxes(head, features, shared, logits, targets)
    forward, fits = head.judge(seen.patches)
    assert fits is not None
    known = seen.ahead != 0
    front = functional.binary_cross_entropy_with_logits(
        forward, (seen.ahead > 0).float(), known.float(), reduction="sum"
    )
    fit = functional.binary_cross_entropy_with_logits(fits, seen.fit, reduction="sum")
    return {"front": front / known.sum().clamp(min=1), "fit": fit / max(len(fits), 1)}


class FoundBoxes(NamedTuple):
    """Boxes that a head finds in labelled maps.

    Attributes:
        patches: (N, 9 C) features in and around them, see `box_patches`.
        group: (N,) number of the class's group.
        ahead: (N,) 1 or -1 for the right or wrong way round; 0: of nothing.
        fit: (N,) how well they fit, in [0, 1], see `_truth`.
    """

    patches: Tensor
    group: Tensor
    ahead: Tensor
    fit: Tensor


def found_boxes(
    head: CentreHead | JudgedHead,
    features: Tensor,
    shared: Tensor,
    logits: Tensor,
    targets: Targets,
    least_score: float = _LEAST_SCORE,
    most: int = _MOST,
) -> FoundBoxes:
    """Return the boxes of a head before it looks again, apart from those near objects that hardly show.

    Gradients reach the features through the patches alone. Arguments as in `judge_losses`, and smallest heat and
    largest number of a map's peaks.
    """
    rows, columns = logits.shape[2:]
    grid = BevGrid((0.0, columns * targets.cell_m), (0.0, rows * targets.cell_m), targets.cell_m)
    with torch.no_grad():
        number, cell, label, _ = find_peaks(logits.detach(), least_score, most)
        sure = ~targets.ignored.flatten(1)[number, cell]
        number, cell, label = number[sure], cell[sure], label[sure]
        code = head.codes(at_cells(shared, number * (rows * columns) + cell))
        boxes, _ = decode_boxes(code, label, cell_centers(cell, grid), grid.cell_m)
        group = torch.from_numpy(GROUP_OF_LABEL).to(label.device)[label]
        ahead, fit = _truth(boxes, label, number, targets, grid)
    return FoundBoxes(patches_of(features, boxes, number, grid), group, ahead, fit)


def _truth(boxes: Tensor, label: Tensor, number: Tensor, targets: Targets, grid: BevGrid) -> tuple[Tensor, Tensor]:
    """Return `ahead` and `fit` of `FoundBoxes`, of boxes (N, 7).

    The fit is min(1, max(0, 2 IoU - 0.5)) with the best true box of the same group (CenterPoint, section 4.2).
    """
    size = grid.shape[0] * grid.shape[1]
    centres = targets.weight == 1
    cell, true_label = targets.cell[centres], targets.label[centres]
    true, _ = decode_boxes(targets.code[centres], true_label, cell_centers(cell % size, grid), grid.cell_m)
    found, there = boxes.double().numpy(force=True), true.double().numpy(force=True)
    there[:, 6] = targets.yaw[centres].numpy(force=True)
    group, true_group = (GROUP_OF_LABEL[each.numpy(force=True)] for each in (label, true_label))
    owner, true_owner = number.numpy(force=True), torch.div(cell, size, rounding_mode="floor").numpy(force=True)
    fit, ahead = np.zeros(len(found), np.float32), np.zeros(len(found), np.float32)
    for k in np.unique(owner):
        rows, others = np.flatnonzero(owner == k), np.flatnonzero(true_owner == k)
        if not len(others):
            continue
        iou = iou_bev(found[rows], there[others]) * (group[rows][:, None] == true_group[others])
        best = iou.argmax(axis=1)
        iou = iou.max(axis=1)
        fit[rows] = np.clip(2 * iou - 0.5, 0.0, 1.0)
        way = np.sign(np.cos(found[rows, 6] - there[others[best], 6]))
        ahead[rows] = np.where(iou >= _SAME_IOU, way, 0.0)
    return torch.from_numpy(ahead).to(boxes.device), torch.from_numpy(fit).to(boxes.device)
