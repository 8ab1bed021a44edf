"""Late fusion: boxes of several agents in one frame become one set without duplicates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.geometry.assignment import match_pairs
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.nms import suppress
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Detections, Ints, Mask
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import normalize_embeddings

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
        detections: boxes of all agents, in one frame.
        iou_threshold: boxes of a class with at least this BEV IoU are one object, in (0, 1].
        merge: one of `MERGES`.

    Returns:
        The merged detections, best score first. Boxes that are not finite are left out.
    """
    boxes, score = detections.boxes.array, detections.score
    order, kept, number = suppress(boxes, score, detections.label, iou_threshold)
    return _merged(detections, order, kept, number, merge)


def merge_matched(groups: Sequence[Detections], iou_threshold: float) -> Detections:
    """Match the boxes of every two agents (Hungarian, 3D IoU), and merge what is matched into weighted means.

    Boxes that are matched directly or through others are one object: of two agents each box has at most one partner,
    and with more agents their order does not matter. What one object's boxes become is as of `merge_duplicates` with
    "mean"; an agent's own duplicates stay.

    Args:
        groups: the detections of one frame, a group per agent.
        iou_threshold: smallest 3D IoU of a match, in (0, 1].

    Returns:
        The merged detections, best score first. Boxes that are not finite are left out.
    """
    joined = DetectionGroups.of(groups)
    finite = np.isfinite(joined.joined.boxes.array).all(axis=1) & np.isfinite(joined.joined.score)
    detections, owner = pool(groups)[finite], joined.group[finite]
    count = len(detections)
    pairs, _ = match_agents(detections.boxes.array, owner, detections.label, iou_threshold)
    edges = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, object_of = connected_components(edges, directed=False)
    order = np.argsort(-detections.score, kind="stable")
    _, first, object_at = np.unique(object_of[order], return_index=True, return_inverse=True)
    # Numbers of objects by their best score, as rows of the result.
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = np.empty(count, dtype=np.int64)
    number[order] = rank[object_at]
    return _merged(detections, order, order[np.sort(first)], number, "mean")


def _merged(detections: Detections, order: Ints, kept: Ints, number: Ints, merge: str) -> Detections:
    """Return K detections of N duplicates: those at `kept` (K,), merged with all of their number (N,), -1 for none.

    `order` has the rows of the duplicates, best score first; it may lack some.
    """
    boxes, score, order = detections.boxes.array, detections.score, order[number[order] >= 0]
    best, covariance = detections.boxes[kept], detections.covariance
    if merge == "mean":
        extent = _weighted_means(boxes, np.maximum(score, _LEAST_WEIGHT), order, number, len(kept))
        best = Boxes3D.trusted(extent[:, :3], extent[:, 3:], best.yaw)
    embedding, seen_by = detections.embedding, detections.seen_by
    return Detections.trusted(
        best,
        score[kept],
        detections.label[kept],
        None if covariance is None else covariance[kept],
        None if embedding is None else _first_embedding(embedding, order, number),
        None if seen_by is None else _seen_by_any(seen_by, number, len(kept)),
    )


def pool(groups: Sequence[Detections]) -> Detections:
    """Concatenate the detections of all agents, a group per agent, each marked with the agent that saw it."""
    joined = DetectionGroups.of(groups)
    whole, seen_by = joined.joined, joined.group[:, None] == np.arange(len(joined))
    return Detections.trusted(whole.boxes, whole.score, whole.label, whole.covariance, whole.embedding, seen_by)


def _first_embedding(embedding: Floats, order: Ints, number: Ints) -> Floats:
    """Return the embeddings (K, D) of K merged boxes: each the first valid one of its boxes' (N, D), by number (N,)."""
    _, present = normalize_embeddings(embedding)
    # Stable: of those that have one, the first stays the first.
    order = order[np.lexsort((~present[order], number[order]))]
    _, first = np.unique(number[order], return_index=True)
    chosen: Floats = embedding[order[first]]
    return chosen


def match_agents(boxes: Floats, owner: Ints, label: Ints, threshold: float) -> tuple[Ints, Floats]:
    """Match the boxes (N, 7) of every two agents and of one class, one to one for the largest sum of 3D IoU.

    Owners (N,) number the agents from 0, and the threshold is > 0. Return the pairs (K, 2) of rows, the lower agent's
    first, and their IoU (K,), in order of agents and rows.
    """
    overlap = iou_3d(boxes, boxes)
    rows, columns = np.nonzero((overlap > 0) & (owner[:, None] < owner) & (label[:, None] == label))
    order = np.lexsort((columns, rows, owner[columns], owner[rows]))
    rows, columns = rows[order], columns[order]
    value = overlap[rows, columns]
    kept = _matched(rows, columns, value, owner) & (value >= threshold)
    return np.column_stack([rows, columns])[kept], value[kept]


@njit(cache=True, nogil=True)
def _matched(rows: Ints, columns: Ints, value: Floats, owner: Ints) -> Mask:
    """Return which pairs (K,), in order of their agents, are in the best matching of their two agents."""
    matched = np.zeros(len(rows), dtype=np.bool_)
    first = 0
    for end in range(1, len(rows) + 1):
        if end < len(rows) and owner[rows[end]] == owner[rows[first]] and owner[columns[end]] == owner[columns[first]]:
            continue
        for each in match_pairs(len(owner), len(owner), rows[first:end], columns[first:end], value[first:end]):
            if each >= 0:
                matched[first + each] = True
        first = end
    return matched


def _weighted_means(boxes: Floats, weight: Floats, order: Ints, number: Ints, count: int) -> Floats:
    """Return the weighted mean centre and size (count, 6) of boxes (N, 7) by number (N,), summed in an order."""
    of, columns = number[order], np.arange(6)
    share = weight[order] / np.bincount(of, weight[order], count)[of]
    weighted = share[:, None] * boxes[order, :6]
    summed = np.bincount((6 * of[:, None] + columns).ravel(), weighted.ravel(), 6 * count)
    return np.asarray(summed, dtype=np.float64).reshape(count, 6)


def _seen_by_any(seen_by: Mask, number: Ints, count: int) -> Mask:
    """Return the mask (count, A) of agents that saw a row of each number, of rows (N, A) by number (N,)."""
    rows, agents = np.nonzero(seen_by & (number >= 0)[:, None])
    seen = np.zeros((count, seen_by.shape[1]), dtype=np.bool_)
    seen[number[rows], agents] = True
    return seen
