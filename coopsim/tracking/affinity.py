"""Affinities of tracks and detections: larger is always better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import box_similarity, iou
from coopsim.geometry.se3 import Floats
from coopsim.tracking.track_states import TrackStates
from coopsim.types import Detections

_SCORE = 7  # its column, after the box


class Affinity(Protocol):
    """A similarity of N tracks and M detections (N, M): larger for more similar pairs, -inf for impossible ones."""

    def __call__(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        """Return the affinity of every pair."""


@dataclass(frozen=True, slots=True)
class Clipping:
    """The cheap part of a kernel: exact values above a floor, where all other pairs need no computation.

    Attributes:
        kernel: boxes (N, 7), (M, 7) and the floor to values (N, M), smaller ones given as the floor.
        floor: below the gates that are common, so that little is left to compute exactly.
        lowest: no finite value is smaller.
    """

    kernel: Callable[[ArrayLike, ArrayLike, float], Floats]
    floor: float
    lowest: float


@dataclass(frozen=True, slots=True)
class BoxAffinity:
    """An affinity that compares a track's box, and maybe its latest score, with those of a detection.

    `Cascade` selects rows of numbers in the place of whole tracks and detections.

    Attributes:
        kernel: boxes (N, 7) and (M, 7) to values (N, M), larger for more similar ones.
        clipping: the cheap part of the kernel, if it has one.
        score_weight: subtracted per unit of difference between the track's latest score and the detection's.
    """

    kernel: Callable[[ArrayLike, ArrayLike], Floats]
    clipping: Clipping | None = None
    score_weight: float = 0.0

    def __call__(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        return self.compare(self.of_tracks(tracks), self.of_detections(detections))

    @staticmethod
    def of_tracks(tracks: TrackStates) -> Floats:
        """Return the rows (N, 8) that are compared: boxes and latest scores."""
        return _joined(tracks.boxes, tracks.latest)

    @staticmethod
    def of_detections(detections: Detections) -> Floats:
        """Return the rows (M, 8) that are compared: boxes and scores."""
        return _joined(detections.boxes.array, detections.score)

    def compare(self, first: Floats, second: Floats) -> Floats:
        """Return the affinity (N, M) of rows (N, 8) and (M, 8)."""
        value = self.kernel(first[:, :_SCORE], second[:, :_SCORE])
        if self.score_weight:
            value = value - self.score_weight * np.abs(first[:, _SCORE, None] - second[:, _SCORE])
        return value


def of_boxes(kernel: Callable[[ArrayLike, ArrayLike], Floats], clipping: Clipping | None = None) -> BoxAffinity:
    """Return the affinity that compares boxes only: `kernel` takes (N, 7) and (M, 7), and gives (N, M)."""
    return BoxAffinity(kernel, clipping)


def _joined(boxes: Floats, score: Floats) -> Floats:
    rows = np.empty((len(score), _SCORE + 1))
    rows[:, :_SCORE], rows[:, _SCORE] = boxes, score
    return rows


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

axial_xiou = of_boxes(box_similarity.axial_xiou, Clipping(box_similarity.axial_xiou, floor=0.2, lowest=0.0))
"""XIOU, in [0, 1], of boxes whose front may be their back."""


def _half_giou(a: ArrayLike, b: ArrayLike, least: float = -np.inf) -> Floats:
    value: Floats = (iou.giou_3d(a, b, 2 * least - 1) + 1) / 2
    return value


half_giou = of_boxes(_half_giou, Clipping(_half_giou, floor=0.2, lowest=0.0))
"""(GIoU + 1) / 2, in (0, 1]: XIOU without headings."""

fgam = of_boxes(box_similarity.fgam)
"""1 less the distance in units of the smaller box, in [0, 1]; -inf beyond one (YOLOO, Gu et al., eq. 8)."""
