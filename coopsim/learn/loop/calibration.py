"""Calibration of a head's scores on held-out maps: a score is then the share of right boxes among those that have it.

Source: Platt 1999, "Probabilistic outputs for support vector machines". A line of the score's logit, for each group of
classes, is fitted to right and wrong boxes by logistic regression.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from coopsim.geometry.iou import iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.learn.loop.validation import doubtful, true_boxes
from coopsim.learn.tasks.training_task import FoundMap
from coopsim.nn.detector.decode import GROUP_OF_LABEL, GROUPS
from coopsim.nn.detector.detector_net import JudgedHead
from coopsim.types import Ints

RIGHT_IOU = (0.5, 0.3, 0.3)
"""BEV IoU from which a box is right, by group: as detection is measured, people and two-wheelers less strictly."""

_PRIOR = 2.0
"""Weight of the identity against the boxes, as that of a few of them. Without any, scores stay as they are."""

_LEAST_SLOPE = 0.05
"""A box of a higher score stays above another one, even where a few boxes say otherwise by chance."""

_BINS = 10
_NEWTON_STEPS = 30

Graded = tuple[Ints, Floats, Floats]
"""Group (N,), logit of the score (N,) and 1 or 0 for right or wrong (N,) of found boxes."""


def judged_head(net: nn.Module) -> JudgedHead | None:
    """Return the head of a network whose scores can be calibrated, if it has one."""
    head = getattr(getattr(net, "fused", net), "head", None)
    return head if isinstance(head, JudgedHead) else None


def calibrate(head: JudgedHead, maps: Sequence[FoundMap]) -> dict[str, float]:
    """Calibrate a head on what it has found, uncalibrated, in held-out maps.

    Return the expected calibration error before and after, by name; that after is of each half of the maps with the
    line of the other half.
    """
    halves = [graded(maps[start::2]) for start in (0, 1)]
    whole: Graded = tuple(np.concatenate(each) for each in zip(*halves, strict=True))  # type: ignore[assignment]
    crossed = [
        np.concatenate(each)
        for each in zip(*(_judged(fit(one), other) for one, other in (halves, halves[::-1])), strict=True)
    ]
    before = expected_error(*_judged(np.array([[1.0, 0.0]] * len(GROUPS)), whole))
    with torch.no_grad():
        head.get_buffer("calibration").copy_(torch.from_numpy(fit(whole)))
    return {"calibration_error_before": before, "calibration_error": expected_error(*crossed)}


def graded(maps: Sequence[FoundMap]) -> Graded:
    """Return the boxes found in maps as `Graded`; those near objects that hardly show are left out."""
    parts = [_graded_map(each) for each in maps]
    empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    return tuple(np.concatenate(each) for each in zip(empty, *parts, strict=True))  # type: ignore[return-value]


def _graded_map(each: FoundMap) -> Graded:
    found, targets, clear = each.detections, each.targets.to("cpu"), ~doubtful(each)
    boxes, score, group = found.boxes.array[clear], found.score[clear], GROUP_OF_LABEL[found.label[clear]]
    right = np.zeros(len(boxes))
    for number, classes in enumerate(GROUPS):
        rows = np.flatnonzero(group == number)
        rows = rows[np.argsort(-score[rows], kind="stable")]
        overlap = iou_bev(boxes[rows], true_boxes(targets, each.grid, [int(cls) for cls in classes]).array)
        for row, overlaps in zip(rows, overlap, strict=True):
            best = int(overlaps.argmax()) if overlaps.size else 0
            if overlaps.size and overlaps[best] >= RIGHT_IOU[number]:
                right[row], overlap[:, best] = 1.0, 0.0  # an object has one right box
    inside = np.clip(score, 1e-6, 1 - 1e-6)
    return group, np.log(inside / (1 - inside)), right


def fit(boxes: Graded) -> Floats:
    """Return slope and shift (3, 2) of each group by Newton's method, pulled towards slope 1 and shift 0.

    Slopes are positive, so that calibrated scores keep their order.
    """
    group, logit, right = boxes
    lines = np.array([[1.0, 0.0]] * len(GROUPS))
    for number, line in enumerate(lines):
        mine = group == number
        columns = np.column_stack([logit[mine], np.ones(mine.sum())])
        for _ in range(_NEWTON_STEPS):
            p = 1 / (1 + np.exp(-columns @ line))
            slope = columns.T @ (p - right[mine]) + _PRIOR * (line - [1.0, 0.0])
            curvature = (columns * (p * (1 - p))[:, None]).T @ columns + _PRIOR * np.eye(2)
            free = [1] if line[0] <= _LEAST_SLOPE and slope[0] > 0 else [0, 1]
            line[free] -= np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
            line[0] = max(line[0], _LEAST_SLOPE)
    return lines


def _judged(lines: Floats, boxes: Graded) -> tuple[Floats, Floats]:
    """Return calibrated scores (N,) and 1 or 0 for right or wrong."""
    group, logit, right = boxes
    slope, shift = lines[group].T
    return 1 / (1 + np.exp(-(slope * logit + shift))), right


def expected_error(score: Floats, right: Floats) -> float:
    """Return the mean distance between scores and the share of right boxes, over ten bins of scores; NaN of none.

    Source: Guo et al. 2017, "On Calibration of Modern Neural Networks", eq. 3.
    """
    if not len(score):
        return float("nan")
    place = np.minimum((score * _BINS).astype(np.int64), _BINS - 1)
    return float(sum(abs((score - right)[place == k].sum()) for k in range(_BINS)) / len(score))
