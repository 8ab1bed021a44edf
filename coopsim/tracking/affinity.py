"""How alike a track and a detection are. An affinity is always larger-is-better."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry.iou import giou_3d, giou_bev, iou_3d, iou_bev
from coopsim.geometry.se3 import Floats

__all__ = ["Affinity", "center_proximity", "giou_3d", "giou_bev", "iou_3d", "iou_bev"]


class Affinity(Protocol):
    """Boxes (N, 7) and (M, 7) to (N, M), larger for pairs that are more alike."""

    def __call__(self, a: ArrayLike, b: ArrayLike, /) -> Floats:
        """The affinity of every pair."""


def center_proximity(a: ArrayLike, b: ArrayLike) -> Floats:
    """Minus the distance of the centres on the ground, m: (N, M) <= 0. A gate of -2 allows 2 m."""
    first, second = np.asarray(a, dtype=np.float64)[:, None, :2], np.asarray(b, dtype=np.float64)[None, :, :2]
    distance: Floats = np.linalg.norm(first - second, axis=2)
    return -distance
