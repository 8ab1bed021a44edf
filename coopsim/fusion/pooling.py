"""Late fusion: boxes of several agents in one frame become one set without duplicates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.fusion.duplicates import owners, seen_by_any, weighted_means
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_threshold
from coopsim.types import Detections, Ints
from coopsim.types.embedding import normalize_embeddings
from coopsim.types.groups import DetectionGroups

_LEAST_WEIGHT = 1e-6


MERGES = ("mean", "nms")
"""Ways to merge duplicates: into their score-weighted mean, or into the best of them."""


def merge_duplicates(detections: Detections, iou_threshold: float, merge: str = "mean") -> Detections:
    """Merge boxes of one object by greedy suppression per class, within and across agents.

    The overlap is the rotated BEV IoU: height is what agents disagree on most, and no two objects share a footprint.
    With "mean", suppressed boxes refine the box that suppressed them: a merged box has the score-weighted mean centre
    and size of its duplicates; everything else is the best-scored one's, heading too, because a mean of headings fails
    where detectors confuse front and back. A score <= 0 (recorded ones need not be probabilities) has next to no
    weight. With "nms", plain non-maximum suppression, the best-scored box stands as it is. Either way the embedding is
    that of the best-scored duplicate that has one, and an object was seen by all agents that saw a duplicate.

    On the V2V4Real training recordings (two cars pooled, AB3DMOT) the mean tracks better than the best box alone at
    every threshold from 0.05 to 0.5: the cars see different sides of an object, and their errors partly cancel. It
    costs some overlap of the matched boxes (AMOTP), and often some identity switches.

    Args:
        detections: of all agents, in one frame.
        iou_threshold: boxes of a class with at least this BEV IoU are one object, in (0, 1].
        merge: one of `MERGES`.

    Returns:
        The merged detections, best score first. Boxes that are not finite are left out.

    Raises:
        InvalidValueError: the threshold is not in (0, 1].
        UnknownNameError: `merge` is not one of `MERGES`.
    """
    require_choice("merge", merge, MERGES)
    require_threshold(iou_threshold=iou_threshold)
    boxes = detections.boxes.array
    order = np.argsort(-detections.score, kind="stable")
    finite = np.isfinite(boxes).all(axis=1) & np.isfinite(detections.score)
    if not finite.all():
        order = order[finite[order]]
    boxes = boxes[order]
    owner = owners(boxes, detections.label[order], iou_threshold)
    own = owner == np.arange(len(owner))
    number = (np.cumsum(own) - 1)[owner]  # of the merged box
    best = detections[order[own]]
    merged = _weighted_mean(boxes, detections.score[order], number, best) if merge == "mean" else best.boxes
    embedding, seen_by = detections.embedding, detections.seen_by
    return Detections.trusted(
        merged,
        best.score,
        best.label,
        best.covariance,
        None if embedding is None else _first_embedding(embedding[order], number),
        None if seen_by is None else seen_by_any(seen_by[order], number, len(best)),
    )


def pool(groups: Sequence[Detections]) -> Detections:
    """Concatenate the detections of all agents, a group per agent, each marked with the agent that saw it."""
    joined = DetectionGroups.of(groups)
    whole, seen_by = joined.joined, joined.group[:, None] == np.arange(len(joined))
    return Detections.trusted(whole.boxes, whole.score, whole.label, whole.covariance, whole.embedding, seen_by)


def _weighted_mean(boxes: Floats, score: Floats, number: Ints, best: Detections) -> Boxes3D:
    """Return the mean centre and size of boxes (N, 7) by merged box (N,), with the heading of the K best ones."""
    extent: Floats = weighted_means(boxes[:, :6].copy(), np.maximum(score, _LEAST_WEIGHT), number, len(best))
    return Boxes3D.trusted(extent[:, :3], extent[:, 3:], best.boxes.yaw)


def _first_embedding(embedding: Floats, number: Ints) -> Floats:
    """Return the embeddings (K, D) of K merged boxes: each the first valid one of its boxes' (N, D), by number (N,)."""
    _, present = normalize_embeddings(embedding)
    order = np.lexsort((~present, number))  # stable: of those that have one, the first stays the first
    _, first = np.unique(number[order], return_index=True)
    chosen: Floats = embedding[order[first]]
    return chosen
