"""Affinities of tracks and detections: larger is always better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import iou
from coopsim.geometry.se3 import Floats
from coopsim.tracking.track_states import TrackStates
from coopsim.types import Detections


class Affinity(Protocol):
    """A similarity of N tracks and M detections (N, M): larger for more similar pairs, -inf for impossible ones."""

    def __call__(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        """Return the affinity of every pair."""


@dataclass(frozen=True, slots=True)
class BoxAffinity:
    """An affinity that compares a track's box, and maybe its latest score, with those of a detection.

    Attributes:
        kernel: similarity of boxes (N, 7) and (M, 7), values (N, M), larger for more similar ones.
        score_weight: loss per unit of difference between the track's latest score and the detection's.
    """

    kernel: Callable[[ArrayLike, ArrayLike], Floats]
    score_weight: float = 0.0

    def __call__(self, tracks: TrackStates, detections: Detections, /) -> Floats:
        value = self.kernel(tracks.boxes, detections.boxes.array)
        if self.score_weight:
            value = value - self.score_weight * np.abs(tracks.latest[:, None] - detections.score)
        return value


iou_3d = BoxAffinity(iou.iou_3d)
"""Volume of the intersection over that of the union, in [0, 1]."""

iou_bev = BoxAffinity(iou.iou_bev)
"""Area of the footprints' intersection over that of their union, in [0, 1]."""

giou_3d = BoxAffinity(iou.giou_3d)
"""Generalized IoU (Rezatofighi et al., CVPR 2019), in (-1, 1]."""

giou_bev = BoxAffinity(iou.giou_bev)
"""Generalized IoU of footprints, in (-1, 1]."""

center_distance = BoxAffinity(iou.center_distance_bev)
"""Minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""

xiou = BoxAffinity(iou.xiou)
"""GIoU and heading together, in [0, 1] (Hu et al., eq. 23)."""

axial_xiou = BoxAffinity(iou.axial_xiou)
"""XIOU, in [0, 1], of boxes whose front may be their back."""


def _half_giou(a: ArrayLike, b: ArrayLike) -> Floats:
    value: Floats = (iou.giou_3d(a, b) + 1) / 2
    return value


half_giou = BoxAffinity(_half_giou)
"""(GIoU + 1) / 2, in (0, 1]: XIOU without headings."""

fgam = BoxAffinity(iou.fgam)
"""1 less the distance in units of the smaller box, in [0, 1]; -inf beyond one (YOLOO, Gu et al., eq. 8)."""
