"""Agreement of each sender with the receiver on places of vehicles that both see, which no third agent can forge."""

from __future__ import annotations

import numpy as np

from coopsim.defenses.consistency import AGREED
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.defense import Claim
from coopsim.interfaces.guard import MOST_SENDERS

_SAME_M, _REACH_M, _VEHICLE_M = 2.0, 30.0, 3.0
"""Largest distance of one vehicle as two agents tell of it, range up to which the receiver places one well, and least
length of one: the heading of shorter bodies is not known."""

_OFF_M, _OFF_RATIO, _RIGHT_RATIO = 0.5, 2.5, 0.8
"""Distance across a vehicle's heading that is off, and likelihood ratios, lying to honest, of a vehicle that is off and
of one that is not. Honest senders are off in 5 % of the cases (`parking_street` and `occluded_crossing`, seeds 3000 to
3002), those that move vehicles by up to 0.9 m in a third. As errors last, the ratios are closer to 1 than that."""

_LEAST, _MOST = 0.5, 4.0
"""Bounds of the ratio of a message: one frame is no proof."""

_NEW = 0.1
"""Weight of the newest message in a sender's mean offset: an error of its pose lasts."""


class SeenTwice:
    """Vehicles in a sender's messages that the receiver detects itself, compared across their headings.

    Errors along the heading are larger, by views of one side and by motion since capture. What moves all objects of a
    sender alike is an error of a pose, and is taken out by the mean over time of the median offset.
    """

    def __init__(self) -> None:
        self._offsets: dict[str, Floats] = {}  # (2,) m in the odometry frame

    def ratio(self, claim: Claim, own: Boxes3D, odom_SE3_base: SE3) -> float:
        """Return the likelihood ratio, lying to honest, of a message beside the receiver's own boxes (M)."""
        apart, yaw = _pairs(claim.detections.boxes, own)
        if not len(apart):
            return AGREED
        apart, yaw = odom_SE3_base.rotate_planar(apart), yaw + odom_SE3_base.yaw
        before = self._offsets.pop(claim.sender, np.zeros(2))
        offset = before + _NEW * (np.median(apart, axis=0) - before)
        self._offsets[claim.sender] = offset
        while len(self._offsets) > MOST_SENDERS:
            self._offsets.pop(next(iter(self._offsets)))
        across = np.einsum("nd,nd->n", apart - offset, np.column_stack([-np.sin(yaw), np.cos(yaw)]))
        off = int((np.abs(across) > _OFF_M).sum())
        return float(np.clip(_OFF_RATIO**off * _RIGHT_RATIO ** (len(across) - off), _LEAST, _MOST))


def _pairs(said: Boxes3D, own: Boxes3D) -> tuple[Floats, Floats]:
    """Return how far (P, 2) vehicles are said from where the receiver detects them, and their headings (P,) rad."""
    own = own[(own.size[:, 0] >= _VEHICLE_M) & (np.hypot(*own.center[:, :2].T) <= _REACH_M)]
    said = said[said.size[:, 0] >= _VEHICLE_M]
    if not len(own) or not len(said):
        return np.zeros((0, 2)), np.zeros(0)
    apart = said.center[:, None, :2] - own.center[None, :, :2]
    far = np.linalg.norm(apart, axis=2)
    nearest, rows = far.argmin(axis=1), np.arange(len(said))
    same = (far[rows, nearest] <= _SAME_M) & (far.argmin(axis=0)[nearest] == rows)
    return apart[rows[same], nearest[same]], own.yaw[nearest[same]]
