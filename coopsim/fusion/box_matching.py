"""Which boxes of two sets, in one frame, lie on the same objects."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.assignment import Pairs, hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_bev
from coopsim.types import Ints


def match_boxes(own: Boxes3D, own_label: Ints, other: Boxes3D, other_label: Ints, gate: float) -> Pairs:
    """Rows (K,) and (K,) of boxes of one class on one object (Hungarian, BEV GIoU).

    Args:
        own: N boxes.
        own_label: (N,) their classes.
        other: M boxes.
        other_label: (M,).
        gate: smallest BEV GIoU of two boxes on one object, in [-1, 1].
    """
    affinity = giou_bev(own.array, other.array)
    affinity[own_label[:, None] != other_label] = -np.inf
    return hungarian(affinity, gate)
