"""Affinities of tracks and detections: larger is always better."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from numpy.typing import ArrayLike

from coopsim.geometry import box_similarity, iou
from coopsim.geometry.se3 import Floats
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections


class Affinity(Protocol):
    """A similarity of N tracks and M detections (N, M): larger for more similar pairs, -inf for impossible ones."""

    def __call__(self, tracks: Tracked, detections: Detections, /) -> Floats:
        """Return the affinity of every pair."""


def of_boxes(kernel: Callable[[ArrayLike, ArrayLike], Floats]) -> Affinity:
    """Return the affinity that compares boxes only: `kernel` takes (N, 7) and (M, 7), and gives (N, M)."""

    def affinity(tracks: Tracked, detections: Detections, /) -> Floats:
        return kernel(tracks.boxes, detections.boxes.array)

    return affinity


iou_3d = of_boxes(iou.iou_3d)
"""Volume of the intersection over that of the union, in [0, 1]."""

iou_bev = of_boxes(iou.iou_bev)
"""Area of the footprints' intersection over that of their union, in [0, 1]."""

giou_3d = of_boxes(iou.giou_3d)
"""Generalized IoU (Rezatofighi et al., CVPR 2019), in (-1, 1]."""

giou_bev = of_boxes(iou.giou_bev)
"""Generalized IoU of footprints, in (-1, 1]."""

center_distance = of_boxes(box_similarity.center_distance_bev)
"""Minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""

xiou = of_boxes(box_similarity.xiou)
"""GIoU and heading together, in [0, 1] (Hu et al., eq. 23)."""

fgam = of_boxes(box_similarity.fgam)
"""1 less the distance in units of the smaller box, in [0, 1]; -inf beyond one (YOLOO, Gu et al., eq. 8)."""
