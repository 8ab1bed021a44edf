"""Detections from the features of a map: peaks of the heat, their boxes, duplicates removed."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.nms import nms_bev
from coopsim.nn.detector.detector_net import LOG_VARIANCE, CentreHead, at_cells, covariances, decode_boxes
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
    head: CentreHead, features: Tensor, grid: BevGrid, *, least_score: float = 0.1, most: int = 300
) -> list[Detections]:
    """Return the detections of each map of a batch, with covariances, in the frame of the grid, without gradients.

    Args:
        head: the head.
        features: (B, C, h, w).
        grid: the cells of the features.
        least_score: smallest score of a detection, in [0, 1].
        most: the most peaks of a map that are looked at.
    """
    with torch.no_grad():
        shared, logits = head.heat(features)
        batch, cell, label, score = _peaks(logits, least_score, most)
        rows, columns = grid.shape
        code = head.codes(at_cells(shared, batch * (rows * columns) + cell))
        boxes, _ = decode_boxes(code, label, cell_centers(cell, grid), grid.cell_m)
        covariance = covariances(code[:, LOG_VARIANCE], boxes)
    group = GROUP_OF_LABEL[label.numpy(force=True)]
    arrays = [each.numpy(force=True) for each in (batch, boxes, score, label, covariance)]
    return [_one(number, group, *arrays) for number in range(len(features))]


def cell_centers(cell: Tensor, grid: BevGrid) -> Tensor:
    """Return the centres (N, 2) m of cells (N,), numbered row by row."""
    columns = grid.shape[1]
    x = grid.x_m[0] + (cell % columns + 0.5) * grid.cell_m
    y = grid.y_m[0] + (torch.div(cell, columns, rounding_mode="floor") + 0.5) * grid.cell_m
    return torch.stack([x, y], dim=1).float()


def _peaks(logits: Tensor, least_score: float, most: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return map, cell, label and score of the cells that are hotter than their neighbours, at most `most` of a map."""
    maps, columns = len(logits), logits.shape[-1]
    parts: list[tuple[Tensor, ...]] = []
    for group in GROUPS:
        heat, which = logits[:, [int(cls) for cls in group]].sigmoid().max(dim=1)
        peak = (functional.max_pool2d(heat[:, None], 3, 1, 1)[:, 0] == heat) & (heat >= least_score)
        number, row, column = torch.nonzero(peak, as_tuple=True)
        label = torch.tensor([int(cls) for cls in group], device=heat.device)[which[number, row, column]]
        parts.append((number, row * columns + column, label, heat[number, row, column]))
    number, cell, label, score = (torch.cat(columns_) for columns_ in zip(*parts, strict=True))
    order = torch.argsort(score, descending=True, stable=True)
    kept = torch.cat([order[number[order] == k][:most] for k in range(maps)])
    return number[kept], cell[kept], label[kept], score[kept]


def _one(number: int, group: np.ndarray, batch, boxes, score, label, covariance) -> Detections:  # type: ignore
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
    )
