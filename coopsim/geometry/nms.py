"""Non-maximum suppression: of boxes on one object the best-scored one stands. Only near pairs are compared."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.iou import common_ground, corner_space
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import Ints, frozen, sealed
from coopsim.support.checks import require_threshold
from coopsim.support.kernels import njit


def nms_bev(boxes: Floats, score: Floats, iou_threshold: float) -> Ints:
    """Suppress boxes that overlap a better one, greedily, by the rotated BEV IoU.

    From best to worst, of equal scores the first one first, a box is kept unless its IoU with a kept box is at least
    the threshold. A suppressed box suppresses nobody. Boxes without area overlap nothing, and so all stay.

    Args:
        boxes: (N, 7) of any class, in any frame.
        score: (N,)
        iou_threshold: in (0, 1].

    Returns:
        The rows (K,) of the kept boxes, best score first. Boxes and scores that are not finite are left out.
    """
    require_threshold(iou_threshold=iou_threshold)
    rows = np.array(frozen(boxes, (None, 7), np.float64, "boxes"), order="C")
    scores = frozen(score, (len(rows),), np.float64, "scores")
    # Writable and read-only as those of detections are, so that the kernel is compiled once.
    _, kept, _ = suppress(rows, scores, sealed(np.zeros(len(rows), dtype=np.int64)), iou_threshold)
    return kept


def suppress(boxes: Floats, score: Floats, label: Ints, iou_threshold: float) -> tuple[Ints, Ints, Ints]:
    """Suppress boxes of a class that overlap a better one, greedily.

    From best to worst, a box (N, 7) is kept unless it overlaps a better kept one of its class by a BEV IoU of at least
    the threshold. Only kept boxes are compared with others, and only with those whose footprints can touch theirs: the
    cost is about that of the boxes around each object.

    Returns:
        The order (N,) from best to worst; the rows (K,) of the kept boxes in that order; and for each row (N,) the
        number in 0..K - 1 of the kept box that stands for it, the rival that it overlaps most, or -1 if it or its score
        is not finite.
    """
    order, along = np.argsort(-score, kind="stable"), np.argsort(boxes[:, 0], kind="stable")
    # Contiguous, so that the kernel is compiled once.
    score, label = np.ascontiguousarray(score), np.ascontiguousarray(label)
    kept, number = _suppress(boxes, score, label, order, along, iou_threshold)
    return order, kept, number


@njit(cache=True, nogil=True)
def _suppress(
    boxes: Floats, score: Floats, label: Ints, order: Ints, along: Ints, iou_threshold: float
) -> tuple[Ints, Ints]:
    """Return the kept rows and the numbers of `suppress`; `along` are the rows in order of their x."""
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    space = corner_space()
    place, free = np.empty(len(boxes), dtype=np.int64), np.empty(len(boxes), dtype=np.bool_)
    widest = 0.0
    for at in range(len(along)):
        row = along[at]
        place[row], free[row] = at, np.isfinite(boxes[row]).all() and np.isfinite(score[row])
        if free[row]:
            widest = max(widest, reach[row])
    candidate = free.copy()
    kept, number, most = np.empty(len(boxes), dtype=np.int64), np.full(len(boxes), -1), np.zeros(len(boxes))
    count = 0
    for row in order:
        if not free[row]:
            continue
        free[row], candidate[row], number[row] = False, False, count
        window = (reach[row] + widest) * (1 + 1e-9)  # rounding must not leave out what just touches
        for step in (-1, 1):
            at = place[row] + step
            while 0 <= at < len(along) and not abs(boxes[along[at], 0] - boxes[row, 0]) > window:
                other = along[at]
                at += step
                if not candidate[other] or label[other] != label[row]:
                    continue
                a, b, both = boxes[row], boxes[other], reach[row] + reach[other]
                if (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 >= both * both:
                    continue
                first = a[0], a[1], a[3], a[4], cos[row], sin[row]
                shared = common_ground(first, (b[0], b[1], b[3], b[4], cos[other], sin[other]), space)
                union = a[3] * a[4] + b[3] * b[4] - shared
                overlap = shared / union if union > 0 else 0.0
                if overlap >= iou_threshold and overlap > most[other]:
                    free[other], number[other], most[other] = False, count, overlap
        kept[count] = row
        count += 1
    return kept[:count], number
