"""Similarities of boxes beyond plain overlap: boxes (N, 7) and (M, 7) to (N, M), always larger is better.

Box order is x, y, z, l, w, h, yaw; both sets are in one frame. No boxes on either side give an empty matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry.iou import giou_3d
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.support.kernels import njit

_YAW = 6


def xiou(a: ArrayLike, b: ArrayLike, least: float = -np.inf) -> Floats:
    """Return the XIOU, in [0, 1]: 3D GIoU times agreement of headings, (GIoU + 1) (cos(difference) + 1) / 4.

    Opposite headings give 0 whatever the overlap, so a detector must know front from back. The enclosing shape is that
    of `giou_3d`, an upright prism: convex, and the smallest such shape (eq. 20) where both boxes have the same floor
    and roof.

    Args:
        a: (N, 7).
        b: (M, 7).
        least: smaller values are returned as this one, which saves the computation of most pairs that lie far apart.

    Source: Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in
    Vehicle-Infrastructure Cooperation", eq. 19-23.
    """
    return _xiou(a, b, least, axial=False)


def axial_xiou(a: ArrayLike, b: ArrayLike, least: float = -np.inf) -> Floats:
    """Return the XIOU, in [0, 1], of boxes whose front may be their back: (GIoU + 1) (|cos(difference)| + 1) / 4.

    It is `xiou` with the second box turned by half a turn where that makes it larger: for detectors that confuse front
    and back.

    Args:
        a: (N, 7).
        b: (M, 7).
        least: smaller values are returned as this one.
    """
    return _xiou(a, b, least, axial=True)


def center_distance_bev(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return minus the distance of the centres on the ground, m, <= 0. A gate of -2 allows 2 m."""
    affinity: Floats = _minus_distance_m(*_boxes(a, b))
    return affinity


def fgam(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return F-GAM, in [0, 1]: 1 less the distance of centres in units of the smaller box, -inf beyond one.

    The source defines a cost: the distance of the centres on the ground over the smaller of the two footprints'
    diagonals, and rules a pair out where it exceeds 1. The affinity is 1 - cost, so that it adds to a similarity as the
    cost adds to a cost (its eq. 9), and no gate needs tuning. A box without a footprint is like no other.

    Source: Gu et al., "YOLOO: You Only Learn from Others Once", eq. 8.
    """
    affinity: Floats = _fgam(*_boxes(a, b))
    return affinity


def _xiou(a: ArrayLike, b: ArrayLike, least: float, axial: bool) -> Floats:
    first, second = _boxes(a, b)
    giou = giou_3d(first, second, 2 * least - 1)
    affinity: Floats = _times_heading(giou, first[:, _YAW], second[:, _YAW], least, axial)
    return affinity


def _boxes(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    first = np.ascontiguousarray(frozen(a, (None, 7), np.float64, "first boxes"))
    return first, np.ascontiguousarray(frozen(b, (None, 7), np.float64, "second boxes"))


@njit(cache=True, nogil=True)
def _times_heading(giou: Floats, first_rad: Floats, second_rad: Floats, least: float, axial: bool) -> Floats:
    """Return the XIOU of pairs with this GIoU (N, M) and these headings (N,) and (M,), in the place of the GIoU."""
    for i in range(len(first_rad)):
        for j in range(len(second_rad)):
            value = least
            if giou[i, j] > 2 * least - 1:
                agree = np.cos(first_rad[i] - second_rad[j])
                value = (giou[i, j] + 1) * ((abs(agree) if axial else agree) + 1) / 4
            giou[i, j] = least if value < least else value
    return giou


@njit(cache=True, nogil=True)
def _minus_distance_m(first: Floats, second: Floats) -> Floats:
    """Return minus the distances (N, M) between centres on the ground, m."""
    out = np.empty((len(first), len(second)))
    for i in range(len(first)):
        for j in range(len(second)):
            out[i, j] = -np.hypot(first[i, 0] - second[j, 0], first[i, 1] - second[j, 1])
    return out


@njit(cache=True, nogil=True)
def _fgam(first: Floats, second: Floats) -> Floats:
    out = np.full((len(first), len(second)), -np.inf)
    reach_a, reach_b = np.hypot(first[:, 3], first[:, 4]), np.hypot(second[:, 3], second[:, 4])
    for i in range(len(first)):
        for j in range(len(second)):
            dx, dy, reach = first[i, 0] - second[j, 0], first[i, 1] - second[j, 1], min(reach_a[i], reach_b[j])
            if abs(dx) <= reach and abs(dy) <= reach and reach > 0:
                cost = np.hypot(dx, dy) / reach
                if cost <= 1:
                    out[i, j] = 1 - cost
    return out
