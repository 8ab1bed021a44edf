"""How alike a track and a detection are. An affinity is always larger-is-better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from coopsim.geometry import iou
from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity import overlap
from coopsim.tracking.motion.constant_velocity import Motion
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections


class Affinity(Protocol):
    """N tracks and M detections to (N, M), larger for pairs that are more alike, -inf for impossible ones."""

    def __call__(self, tracks: Tracked, found: Detections, /) -> Floats:
        """The affinity of every pair."""


def of_boxes(kernel: Callable[[ArrayLike, ArrayLike], Floats]) -> Affinity:
    """The affinity that looks at boxes only: `kernel` takes (N, 7) and (M, 7), and gives (N, M)."""

    def affinity(tracks: Tracked, found: Detections, /) -> Floats:
        return kernel(tracks.boxes, found.boxes.array)

    return affinity


iou_3d = of_boxes(iou.iou_3d)
"""Volume of the intersection over that of the union, in [0, 1]."""

iou_bev = of_boxes(iou.iou_bev)
"""The same of footprints."""

giou_3d = of_boxes(iou.giou_3d)
"""Generalized IoU (Rezatofighi et al., CVPR 2019), in (-1, 1]."""

giou_bev = of_boxes(iou.giou_bev)
"""The same of footprints."""

center_distance = of_boxes(overlap.center_distance_bev)
"""Minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""

xiou = of_boxes(overlap.xiou)
"""GIoU and heading together, in [0, 1] (Hu et al., eq. 23)."""

fgam = of_boxes(overlap.fgam)
"""1 less the distance in units of the smaller box, in [0, 1]; -inf beyond one (YOLOO, Gu et al., eq. 8)."""


@dataclass(frozen=True, slots=True)
class Mahalanobis:
    """Minus the squared Mahalanobis distance of a detection from where its track is expected, <= 0.

    Attributes:
        motion: the motion model of the tracker.
        planar: compare x and y only.
    """

    motion: Motion
    planar: bool = False

    def __call__(self, tracks: Tracked, found: Detections, /) -> Floats:
        covariance = self.motion.measurement_covariance(tracks.beliefs)
        return overlap.mahalanobis(tracks.boxes, covariance, found.boxes.array, planar=self.planar)
