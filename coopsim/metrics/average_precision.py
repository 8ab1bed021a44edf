"""Average precision of boxes, frame by frame, whatever their identities.

In each frame boxes are taken by falling score; each gets the object of largest IoU that is still free, if that reaches
the threshold, as in OpenCOOD. The area under the curve of precision over recall is PASCAL VOC's since 2010: every
precision is raised to the best one at any higher recall. Equal scores are one step of the curve, and within a frame the
box that fits better is taken first, so the order in which boxes are listed changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d_and_bev
from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, frame_of
from coopsim.support.arrays import frozen
from coopsim.support.checks import require_choice, require_threshold
from coopsim.support.kernels import njit
from coopsim.types import Detections, GroundTruth, Ints

AP_THRESHOLDS = (0.3, 0.5, 0.7)


AnyBoxes = Boxes3D | ArrayLike
"""`Boxes3D`, or an array (N, 7) of x, y, z, l, w, h, yaw."""

DetectedFrame = Detections | tuple[AnyBoxes, ArrayLike] | tuple[AnyBoxes, ArrayLike, ArrayLike]
TruthFrame = GroundTruth | AnyBoxes | tuple[AnyBoxes, ArrayLike]


def average_precision_of(
    detections: Sequence[DetectedFrame],
    truth: Sequence[TruthFrame],
    iou: float = 0.5,
    *,
    view: Literal["3D", "BEV"] = "3D",
    sort: Literal["pooled", "frame"] = "pooled",
) -> float:
    """Compute the average precision of plain lists of boxes, one item per frame, in [0, 1].

    Boxes are `Boxes3D` or arrays (N, 7) of x, y, z, l, w, h, yaw (m, rad; z is the centre), in any frame of reference
    that the detections and the truth of an item share. Where both sides have labels, a detection can only match an
    object of its label; without labels on a side, any object. The result is of all labels pooled: for a mean over
    classes, call it for each class.

    Args:
        detections: per frame `Detections`, or a tuple (boxes, scores) or (boxes, scores, labels).
        truth: per frame `GroundTruth`, or boxes, or a tuple (boxes, labels).
        iou: IoU from which a detection is on an object, in (0, 1].
        view: "3D" for the IoU of volumes, "BEV" for that of the rectangles seen from above.
        sort: "pooled" ranks the detections of all frames together by score, as the papers define it and as CoAlign and
            HEAL do; equal scores are one step of the curve. "frame" ranks within each frame and concatenates the
            frames, as OpenCOOD and code derived from it do by default: false positives of early frames then stand
            before matches of later frames, so the value is lower, and equal scores stand in the order in which they
            are given. Use it to compare with their tables, for nothing else.

    Returns:
        The average precision; 0 without objects.

    Raises:
        InvalidValueError: shapes do not fit, a value is not finite, or the lists differ in length.
        UnknownNameError: `view` or `sort` is not one of those above.
    """
    require_threshold(iou=iou)
    require_choice("view", view, ("3D", "BEV"))
    require_choice("sort", sort, ("pooled", "frame"))
    if len(detections) != len(truth):
        raise InvalidValueError(
            f"detections and truth must have one item per frame, got {len(detections)} and {len(truth)}"
        )
    objects, hits, scores = 0, [np.zeros(0, dtype=bool)], [np.zeros(0)]
    for k, (found, there) in enumerate(zip(detections, truth, strict=True)):
        boxes, score, label = _detected(found, f"detections[{k}]")
        true_boxes, true_label = _true(there, f"truth[{k}]")
        overlap = iou_3d_and_bev(true_boxes.array, boxes.array)[view == "BEV"]
        if label is not None and true_label is not None:
            overlap[true_label[:, None] != label] = 0.0
        rows, columns = np.nonzero(overlap >= iou)
        frame = SequenceArrays(
            _one_frame(len(true_boxes)), np.arange(len(true_boxes)), _one_frame(len(boxes)), np.arange(len(boxes)),
            _one_frame(len(rows)), rows, columns, overlap[rows, columns],
        )  # fmt: skip
        order = order_by_score(frame, score) if sort == "pooled" else np.argsort(-score, kind="stable")
        objects += len(true_boxes)
        hits.append(match_by_score(frame, order)[order] >= 0)
        scores.append(score[order])
    ranked, score = np.concatenate(hits), np.concatenate(scores)
    return area_of_all_points(ranked, objects, score if sort == "pooled" else None)


def average_precision(sequences: Iterable[tuple[NumberedSequence, Floats]]) -> float:
    """Compute the average precision over sequences, ranked together, in [0, 1]; 0 without objects.

    Each comes with the pairs at or above the threshold, and the score of every reported box (T,).
    """
    truth, hits, scores = 0, [np.zeros(0, dtype=bool)], [np.zeros(0)]
    for sequence, score in sequences:
        data = sequence.arrays
        truth += len(data.truth)
        hits.append(match_by_score(data, order_by_score(data, score)) >= 0)
        scores.append(score)
    return area_of_all_points(np.concatenate(hits), truth, np.concatenate(scores))


def order_by_score(data: SequenceArrays, score: Floats) -> Ints:
    """Return the order (T,) of reported boxes: frame by frame by falling score, equal ones by their best similarity."""
    best = np.zeros(len(score))
    np.maximum.at(best, data.track_start[frame_of(data.pair_start)] + data.pair_track, data.pair_similarity)
    order: Ints = np.lexsort((-best, -score, frame_of(data.track_start)))
    return order


def area_of_all_points(hits: NDArray[np.bool_], truth: int, scores: Floats | None = None) -> float:
    """Compute the area under the curve of ranked hits and misses (R,), each precision raised to the best beyond it.

    Args:
        hits: in order of rank if there are no scores.
        truth: number of objects.
        scores: (R,) rank the hits; equal ones are one step, with the precision at its end. None: each hit is a step.
    """
    last = np.arange(len(hits))
    if scores is not None:
        order = np.argsort(-scores)
        hits, last = hits[order], ends_of_steps(scores[order])
    precision = np.cumsum(hits)[last] / (last + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    return float(best_from_here[hits].sum()) / max(truth, 1)


def ends_of_steps(scores: Floats) -> Ints:
    """Return the last place (R,) of those with the same score as each, in a falling order of scores (R,)."""
    ends: Ints = np.searchsorted(-scores, -scores, side="right") - 1
    return ends


@njit(cache=True, nogil=True)
def match_by_score(data: SequenceArrays, order: Ints) -> Ints:
    """Match reported boxes one after another, each with the free object of largest similarity.

    The boxes come in an order (T,), frame by frame; the pairs are those at or above the threshold. Return the row (T,)
    in `data.truth` of each box's object, or -1.
    """
    object_of = np.full(len(data.track), -1)
    for frame in range(len(data.track_start) - 1):
        first, end = data.pair_start[frame], data.pair_start[frame + 1]
        free = np.ones(data.truth_start[frame + 1] - data.truth_start[frame], np.bool_)
        for box in order[data.track_start[frame] : data.track_start[frame + 1]]:
            best = -1
            for pair in range(first, end):
                if data.pair_track[pair] + data.track_start[frame] != box or not free[data.pair_truth[pair]]:
                    continue
                if best < 0 or data.pair_similarity[pair] > data.pair_similarity[best]:
                    best = pair
            if best >= 0:
                free[data.pair_truth[best]] = False
                object_of[box] = data.truth_start[frame] + data.pair_truth[best]
    return object_of


def _detected(given: Any, what: str) -> tuple[Boxes3D, Floats, Ints | None]:
    parts = (given.boxes, given.score, given.label) if isinstance(given, Detections) else given
    if not (isinstance(parts, tuple) and len(parts) in (2, 3)):
        raise InvalidValueError(
            f"{what} must be Detections or a tuple (boxes, scores) or (boxes, scores, labels), got {given!r}"
        )
    boxes = _boxes(parts[0], what)
    score = frozen(parts[1], (len(boxes),), np.float64, f"{what}: scores")
    if not np.isfinite(score).all():
        raise InvalidValueError(f"{what}: scores must be finite, got {score[~np.isfinite(score)][0]}")
    label = frozen(parts[2], (len(boxes),), np.int64, f"{what}: labels") if len(parts) == 3 else None
    return boxes, score, label


def _true(given: Any, what: str) -> tuple[Boxes3D, Ints | None]:
    parts = (given.boxes, given.label) if isinstance(given, GroundTruth) else given
    if not isinstance(parts, tuple):
        return _boxes(parts, what), None
    if len(parts) != 2:
        raise InvalidValueError(f"{what} must be GroundTruth, boxes, or a tuple (boxes, labels), got {given!r}")
    boxes = _boxes(parts[0], what)
    return boxes, frozen(parts[1], (len(boxes),), np.int64, f"{what}: labels")


def _boxes(given: Any, what: str) -> Boxes3D:
    boxes = given if isinstance(given, Boxes3D) else Boxes3D.from_array(frozen(given, (None, 7), np.float64, what))
    boxes.validate(what)
    return boxes


def _one_frame(count: int) -> Ints:
    return np.array([0, count])


def separation(similarity: ArrayLike, same: ArrayLike) -> float:
    """Return the probability that a pair of one object is more similar than a pair of two: the area under the ROC.

    1 tells all apart, 0.5 is chance; equal similarities count half. NaN without pairs of both kinds, which `same` (K,)
    tells.
    """
    same = np.asarray(same, dtype=bool)
    alike, unlike = int(same.sum()), int((~same).sum())
    if not alike or not unlike:
        return math.nan
    _, place, count = np.unique(np.asarray(similarity, dtype=np.float64), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[place]  # equal ones share the mean of their ranks
    return float((ranks[same].sum() - alike * (alike + 1) / 2) / (alike * unlike))
