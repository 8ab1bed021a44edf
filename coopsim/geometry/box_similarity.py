"""Similarities of boxes beyond plain overlap: boxes (N, 7) and (M, 7) to (N, M), always larger is better.

Box order is x, y, z, l, w, h, yaw; both sets are in one frame. No boxes on either side give an empty matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry.iou import giou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen

_YAW = 6


def xiou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the XIOU, in [0, 1]: 3D GIoU times agreement of headings, (GIoU + 1) (cos(difference) + 1) / 4.

    Opposite headings give 0 whatever the overlap, so a detector must know front from back. The enclosing shape is that
    of `giou_3d`, an upright prism: convex, and the smallest such shape (eq. 20) where both boxes have the same floor
    and roof.

    Source: Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in
    Vehicle-Infrastructure Cooperation", eq. 19-23.
    """
    first, second = _boxes(a, b)
    heading: Floats = np.cos(first[:, None, _YAW] - second[:, _YAW])
    return (giou_3d(first, second) + 1) * (heading + 1) / 4


def center_distance_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""
    first, second = _boxes(a, b)
    return -_distance_m(first, second)


def fgam(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return F-GAM, in [0, 1]: 1 less the distance of centres in units of the smaller box, -inf beyond one.

    The source defines a cost: the distance of the centres on the ground over the smaller of the two footprints'
    diagonals, and rules a pair out where it exceeds 1. The affinity is 1 - cost, so that it adds to a similarity as the
    cost adds to a cost (its eq. 9), and no gate needs tuning. A box without a footprint is like no other.

    Source: Gu et al., "YOLOO: You Only Learn from Others Once", eq. 8.
    """
    first, second = _boxes(a, b)
    diagonals = (np.hypot(rows[:, 3], rows[:, 4]) for rows in (first, second))
    smaller_m = np.minimum.outer(*diagonals)
    cost = np.full(smaller_m.shape, np.inf)
    np.divide(_distance_m(first, second), smaller_m, out=cost, where=smaller_m > 0)
    return np.where(cost <= 1, 1 - cost, -np.inf)


def _boxes(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    return frozen(a, (None, 7), np.float64, "first boxes"), frozen(b, (None, 7), np.float64, "second boxes")


def _distance_m(first: Floats, second: Floats) -> Floats:
    """Return the distances (N, M) between centres on the ground, m."""
    x, y = (np.subtract.outer(first[:, axis], second[:, axis]) for axis in (0, 1))
    distance: Floats = np.hypot(x, y)
    return distance
