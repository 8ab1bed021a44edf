"""How alike a track and a detection are. An affinity is always larger-is-better."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import iou
from coopsim.geometry.se3 import Floats
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


def _center_proximity(a: ArrayLike, b: ArrayLike) -> Floats:
    first, second = np.asarray(a, dtype=np.float64)[:, None, :2], np.asarray(b, dtype=np.float64)[None, :, :2]
    distance: Floats = np.linalg.norm(first - second, axis=2)
    return -distance


iou_3d = of_boxes(iou.iou_3d)
"""Volume of the intersection over that of the union, in [0, 1]."""

iou_bev = of_boxes(iou.iou_bev)
"""The same of footprints."""

giou_3d = of_boxes(iou.giou_3d)
"""Generalized IoU (Rezatofighi et al., CVPR 2019), in (-1, 1]."""

giou_bev = of_boxes(iou.giou_bev)
"""The same of footprints."""

center_proximity = of_boxes(_center_proximity)
"""Minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""
