"""Late fusion: boxes of several agents in one frame become one set without duplicates."""

from __future__ import annotations

import numpy as np

from coopsim.checks import require_threshold
from coopsim.geometry.iou import iou_bev
from coopsim.types import Detections


def merge_duplicates(detections: Detections, iou_threshold: float) -> Detections:
    """Keep the best-scored of boxes that overlap: greedy non-maximum suppression per class.

    The overlap is the rotated BEV IoU: height is what agents disagree on most, and no two objects share a footprint.

    Args:
        detections: of all agents, in one frame.
        iou_threshold: boxes of a class with at least this BEV IoU are one object, in (0, 1].

    Returns:
        The kept detections, best score first. Boxes that are not finite are left out.
    """
    require_threshold(iou_threshold=iou_threshold)
    array = detections.boxes.array
    finite = np.isfinite(array).all(axis=1) & np.isfinite(detections.score)
    order = np.flatnonzero(finite)[np.argsort(-detections.score[finite], kind="stable")]
    ordered = detections[order]
    overlap = iou_bev(ordered.boxes.array, ordered.boxes.array)
    rivals = (overlap >= iou_threshold) & (ordered.label[:, None] == ordered.label)
    # Whoever has a better-scored rival may go; whether it does depends on whether that rival stays.
    kept = np.ones(len(ordered), dtype=bool)
    for row in np.flatnonzero(np.triu(rivals, k=1).any(axis=1)):
        if kept[row]:
            kept[row + 1 :] &= ~rivals[row, row + 1 :]
    return ordered[kept]
