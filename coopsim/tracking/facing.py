"""Which way tracks face: detectors confuse front and back, motion does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import wrap_angle
from coopsim.types import Tracks

MOVING_M_S = 2.0
"""What is faster faces where it goes."""


def facing_forwards(tracks: Tracks) -> Tracks:
    """Return tracks, those that move (2 m/s) and face backwards turned around; others face as they did."""
    (x, y), yaw_rad = tracks.velocity.T, tracks.boxes.yaw
    backwards = (np.hypot(x, y) > MOVING_M_S) & (np.cos(yaw_rad) * x + np.sin(yaw_rad) * y < 0)
    faced_rad = np.where(backwards, wrap_angle(yaw_rad + np.pi), yaw_rad)
    return replace(tracks, boxes=replace(tracks.boxes, yaw=faced_rad))
