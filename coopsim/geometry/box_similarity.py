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
    return (giou_3d(a, b) + 1) * (_same_heading(a, b) + 1) / 4


def axial_xiou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the XIOU, in [0, 1], of boxes whose front may be their back: (GIoU + 1) (|cos(difference)| + 1) / 4.

    It is `xiou` with the second box turned by half a turn where that makes it larger: for detectors that confuse front
    and back.
    """
    return (giou_3d(a, b) + 1) * (np.abs(_same_heading(a, b)) + 1) / 4


def center_distance_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""
    return -_distance_m(*_boxes(a, b))


def fgam(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return F-GAM, in [0, 1]: 1 less the distance of centres in units of the smaller box, -inf beyond one.

    The source defines a cost: the distance of the centres on the ground over the smaller of the two footprints'
    diagonals, and rules a pair out where it exceeds 1. The affinity is 1 - cost, so that it adds to a similarity as the
    cost adds to a cost (its eq. 9), and no gate needs tuning. A box without a footprint is like no other.

    Source: Gu et al., "YOLOO: You Only Learn from Others Once", eq. 8.
    """
    first, second = _boxes(a, b)
    reach = np.minimum.outer(np.hypot(first[:, 3], first[:, 4]), np.hypot(second[:, 3], second[:, 4]))
    cost = np.divide(_distance_m(first, second), reach, out=np.full(reach.shape, np.inf), where=reach > 0)
    return np.where(cost <= 1, 1 - cost, -np.inf)


def _boxes(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    return frozen(a, (None, 7), np.float64, "first boxes"), frozen(b, (None, 7), np.float64, "second boxes")


def _distance_m(first: Floats, second: Floats) -> Floats:
    """Return the distances (N, M) m of centres on the ground."""
    distance_m: Floats = np.hypot(first[:, 0, None] - second[:, 0], first[:, 1, None] - second[:, 1])
    return distance_m


def _same_heading(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the cosine (N, M) of the differences of headings."""
    first, second = _boxes(a, b)
    cosine: Floats = np.cos(first[:, _YAW, None] - second[:, _YAW])
    return cosine
