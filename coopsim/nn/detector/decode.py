"""Detections from the features of a map: peaks of the heat, their boxes, duplicates removed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.nms import nms_bev
from coopsim.nn.detector.box_judge import patches_of
from coopsim.nn.detector.detector_net import (
    LOG_VARIANCE,
    CentreHead,
    JudgedHead,
    at_cells,
    covariances,
    decode_boxes,
)
from coopsim.types import BevGrid, Detections
from coopsim.types.taxonomy import ObjectClass

GROUPS: tuple[tuple[ObjectClass, ...], ...] = (
    (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS),
    (ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE, ObjectClass.SCOOTER),
    (ObjectClass.PEDESTRIAN, ObjectClass.CHILD),
)
"""Classes that one object can be taken for: a cell is at most one object of each group."""

GROUP_OF_LABEL = np.array([next(k for k, group in enumerate(GROUPS) if cls in group) for cls in ObjectClass])
"""By label: number of the group."""

DUPLICATE_IOU = 0.15
"""BEV IoU from which two boxes of a group are one object, as in OpenCOOD."""


def decode(
    head: CentreHead | JudgedHead,
    features: Tensor,
    grid: BevGrid,
    *,
    least_score: float = 0.1,
    most: int = 300,
    moving: Sequence[bool] | None = None,
) -> list[Detections]:
    """Return the detections of each map of a batch, with covariances, in the frame of the grid, without gradients.

    Args:
        head: the head.
        features: (B, C, h, w).
        grid: the cells of the features.
        least_score: smallest score of a detection, in [0, 1].
        most: the most peaks of a map that are looked at.
        moving: for each map, True if its features show motion, so that velocities are stated; None: none does.
    """
    with torch.no_grad():
        shared, logits = head.heat(features)
        # The second look may make more of a peak than its heat.
        least = least_score**2 if isinstance(head, JudgedHead) else least_score
        batch, cell, label, score = find_peaks(logits, least, most)
        rows, columns = grid.shape
        code = head.codes(at_cells(shared, batch * (rows * columns) + cell))
        boxes, velocity = decode_boxes(code, label, cell_centers(cell, grid), grid.cell_m)
        covariance = covariances(code[:, LOG_VARIANCE], boxes)
        group = torch.from_numpy(GROUP_OF_LABEL).to(label.device)[label]
        if head.judge is not None:
            patches = patches_of(features, boxes, batch, grid)
            boxes, score = head.second_look(boxes, score, group, patches)
    kept = np.flatnonzero(score.numpy(force=True) >= least_score)
    arrays = [each.numpy(force=True)[kept] for each in (group, batch, boxes, score, label, covariance, velocity)]
    known = [False] * len(features) if moving is None else moving
    return [_one(number, known[number], *arrays) for number in range(len(features))]


def cell_centers(cell: Tensor, grid: BevGrid) -> Tensor:
    """Return the centres (N, 2) m of cells (N,), numbered row by row."""
    columns = grid.shape[1]
    x = grid.x_m[0] + (cell % columns + 0.5) * grid.cell_m
    y = grid.y_m[0] + (torch.div(cell, columns, rounding_mode="floor") + 0.5) * grid.cell_m
    return torch.stack([x, y], dim=1).float()


def find_peaks(logits: Tensor, least_score: float, most: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return map, cell, label and score of the cells that are hotter than their neighbours, at most `most` of a map.

    Maps are in order, and each one's peaks, too, the hottest first.
    """
    maps, columns = len(logits), logits.shape[-1]
    parts: list[tuple[Tensor, ...]] = []
    for group in GROUPS:
        heat, which = logits[:, [int(cls) for cls in group]].sigmoid().max(dim=1)
        number, row, column = torch.nonzero(heat >= least_score, as_tuple=True)
        around = functional.pad(heat, (1, 1, 1, 1))
        near = torch.stack([around[number, row + i, column + j] for i in range(3) for j in range(3)], dim=1)
        peak = near.amax(1) == heat[number, row, column]
        number, row, column = number[peak], row[peak], column[peak]
        label = torch.tensor([int(cls) for cls in group], device=heat.device)[which[number, row, column]]
        parts.append((number, row * columns + column, label, heat[number, row, column]))
    number, cell, label, score = (torch.cat(columns_) for columns_ in zip(*parts, strict=True))
    order = torch.argsort(score, descending=True, stable=True)
    order = order[torch.argsort(number[order], stable=True)]
    count = torch.bincount(number, minlength=maps)
    rank = torch.arange(len(order), device=order.device) - (count.cumsum(0) - count)[number[order]]
    kept = order[rank < most]
    return number[kept], cell[kept], label[kept], score[kept]


def _one(number: int, known, group, batch, boxes, score, label, covariance, velocity) -> Detections:  # type: ignore
    mine = np.flatnonzero(batch == number)
    kept = [np.zeros(0, np.int64)]
    for each in range(len(GROUPS)):
        rows = mine[group[mine] == each]
        kept.append(rows[nms_bev(boxes[rows].astype(np.float64), score[rows].astype(np.float64), DUPLICATE_IOU)])
    rows = np.concatenate(kept)
    rows = rows[np.argsort(-score[rows], kind="stable")]
    return Detections(
        Boxes3D.from_array(boxes[rows].astype(np.float64)),
        score[rows].astype(np.float64),
        label[rows].astype(np.int64),
        covariance[rows],
        velocity=velocity[rows].astype(np.float64) if known else None,
    )
