"""Affinities of tracks and detections: larger is always better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import box_similarity, iou
from coopsim.geometry.se3 import Floats
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections


class Affinity(Protocol):
    """A similarity of N tracks and M detections (N, M): larger for more similar pairs, -inf for impossible ones."""

    def __call__(self, tracks: Tracked, detections: Detections, /) -> Floats:
        """Return the affinity of every pair."""


@dataclass(frozen=True, slots=True)
class Clipping:
    """The cheap part of an affinity: exact values above a floor, where all other pairs need no computation.

    Attributes:
        kernel: rows (N, k), (M, k) and the floor to the affinity (N, M), smaller values given as the floor.
        floor: below the gates that are common, so that little is left to compute exactly.
        lowest: no finite affinity is smaller.
    """

    kernel: Callable[[ArrayLike, ArrayLike, float], Floats]
    floor: float
    lowest: float


@dataclass(frozen=True, slots=True)
class RowAffinity:
    """An affinity that compares one row of numbers of each track with one of each detection.

    `Cascade` selects such rows in the place of whole tracks and detections.

    Attributes:
        of_tracks: tracks to rows (N, k).
        of_detections: detections to rows (M, k).
        kernel: rows (N, k) and (M, k) to the affinity (N, M).
        clipping: the cheap part of the kernel, if it has one.
    """

    of_tracks: Callable[[Tracked], Floats]
    of_detections: Callable[[Detections], Floats]
    kernel: Callable[[ArrayLike, ArrayLike], Floats]
    clipping: Clipping | None = None

    def __call__(self, tracks: Tracked, detections: Detections, /) -> Floats:
        return self.kernel(self.of_tracks(tracks), self.of_detections(detections))


def of_boxes(kernel: Callable[[ArrayLike, ArrayLike], Floats], clipping: Clipping | None = None) -> RowAffinity:
    """Return the affinity that compares boxes only: `kernel` takes (N, 7) and (M, 7), and gives (N, M)."""
    return RowAffinity(lambda tracks: tracks.boxes, lambda detections: detections.boxes.array, kernel, clipping)


def _iou_3d(a: ArrayLike, b: ArrayLike, least: float) -> Floats:
    return np.maximum(iou.iou_3d(a, b), least)


iou_3d = of_boxes(iou.iou_3d, Clipping(_iou_3d, floor=0.0, lowest=0.0))
"""Volume of the intersection over that of the union, in [0, 1]."""

iou_bev = of_boxes(iou.iou_bev)
"""Area of the footprints' intersection over that of their union, in [0, 1]."""

giou_3d = of_boxes(iou.giou_3d, Clipping(iou.giou_3d, floor=-0.6, lowest=-1.0))
"""Generalized IoU (Rezatofighi et al., CVPR 2019), in (-1, 1]."""

giou_bev = of_boxes(iou.giou_bev, Clipping(iou.giou_bev, floor=-0.6, lowest=-1.0))
"""Generalized IoU of footprints, in (-1, 1]."""

center_distance = of_boxes(box_similarity.center_distance_bev)
"""Minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""

xiou = of_boxes(box_similarity.xiou, Clipping(box_similarity.xiou, floor=0.2, lowest=0.0))
"""GIoU and heading together, in [0, 1] (Hu et al., eq. 23)."""

fgam = of_boxes(box_similarity.fgam)
"""1 less the distance in units of the smaller box, in [0, 1]; -inf beyond one (YOLOO, Gu et al., eq. 8)."""
