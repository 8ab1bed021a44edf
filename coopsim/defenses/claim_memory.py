"""Memory of what each sender claimed, so that evidence on one object adds up from frame to frame."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.guard import MOST_SENDERS
from coopsim.types import NS_PER_S, Detections

_SAME_M, _FORGOTTEN_S = 2.5, 1.0
"""Largest distance of one object in two messages, which is 0.1 s at 25 m/s, and time after which it is forgotten."""

_MOST_OBJECTS = 512
"""Most objects of a sender: more would be no description of a street."""


class ClaimMemory:
    """Evidence for and against the objects that each sender claims, which fades with every message.

    Args:
        fading: share of the evidence that is left after a message.
    """

    def __init__(self, fading: float = 0.9) -> None:
        self._fading = fading
        self._known: dict[str, Floats] = {}  # (K, 5): x, y m in the odometry frame, time s, evidence for and against

    def add(self, sender: str, found: Detections, odom_SE3_base: SE3, time_ns: int, evidence: Floats) -> Floats:
        """Add evidence (N, 2) for and against N claimed objects in the base frame; return all of it (N, 2)."""
        place, now_s = odom_SE3_base.apply(found.boxes.center)[:, :2], time_ns / NS_PER_S
        known = self._known.pop(sender, np.zeros((0, 5)))
        known = known[known[:, 2] >= now_s - _FORGOTTEN_S]
        total = np.array(evidence, dtype=np.float64)
        if len(known) and len(place):
            apart = np.hypot(*(place[:, None] - known[None, :, :2]).transpose(2, 0, 1))
            nearest = apart.argmin(axis=1)
            same = apart[np.arange(len(place)), nearest] <= _SAME_M
            total[same] += self._fading * known[nearest[same], 3:]
            known = np.delete(known, nearest[same], axis=0)
        rows = np.column_stack([place, np.full(len(place), now_s), total])
        self._known[sender] = np.concatenate([rows, known])[:_MOST_OBJECTS]
        while len(self._known) > MOST_SENDERS:
            self._known.pop(next(iter(self._known)))
        return total
